"""One module for each file format; `srt3d_ros.datasets.READERS` lists them by suffix."""
