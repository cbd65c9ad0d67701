"""The work that is done for every pixel, once for each kind of device: `cpu` (numba) and `cuda` (Triton)."""
