"""The work that is done for every pixel: one contract, that of `reference`, and two backends, `cpu` and `cuda`."""
