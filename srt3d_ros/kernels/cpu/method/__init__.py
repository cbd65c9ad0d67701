"""The steps of a frame of the default method: numba."""
