"""Simulated scenes, motions and photons, with the truth attached."""
