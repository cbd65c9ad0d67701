"""One module a file format; `srt3d_ros.datasets.READERS` has them by suffix."""
