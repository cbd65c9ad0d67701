"""The work that is done for every pixel: one contract, `api`, and three backends, `reference`, `cpu` and `cuda`."""
