"""`srt3d reconstruct`: what it does with a frame, and with many: each to a file, in processes or on a Dask cluster."""
