"""Where a sensor was, and sketches moved along."""
