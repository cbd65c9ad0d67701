"""Simulate scenes, motions and photons, with the truth."""
