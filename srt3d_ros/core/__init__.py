"""Sensor model, photons, sketching, reconstruction and metrics: plain data in, plain data out."""
