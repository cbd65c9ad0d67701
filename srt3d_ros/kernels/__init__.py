"""The work that is done for every pixel: in torch (the contract, and what a GPU runs), and in numba for the CPU."""
