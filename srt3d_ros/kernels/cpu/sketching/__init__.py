"""Photons into sketches, and sketches that move with the sensor: numba."""
