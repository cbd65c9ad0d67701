"""Sensor model, photons, sketching, reconstruction and metrics. Imports NumPy only."""
