"""What `srt3d evaluate` does: every method on simulated scenes and photon files, compared with the truth."""
