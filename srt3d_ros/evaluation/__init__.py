"""Run every method on simulated scenes and photon files, and compare its clouds with the truth."""
