"""Work per pixel: kernels in torch (the contract, and what runs on a GPU) and in numba (for the CPU)."""
