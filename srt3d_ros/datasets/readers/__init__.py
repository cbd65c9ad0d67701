"""One module for each file format; `srt3d_ros.datasets.FILE_READERS` lists them by suffix."""
