"""From packets of photons to sketches."""
