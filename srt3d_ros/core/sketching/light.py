"""Measures how much signal a frame's photons have, and up to which frequency they agree with the IRF.

The distance of two signal photons of a pixel is that of two draws of the IRF, at any depth; a background photon lies
anywhere. So the mean of cos ω(x − x') over pairs of a pixel's photons is p² |ĥ(ω)|², p the share of signal. A sketch
has the sum over pairs, |Σ_x exp(i ω x)|² = n + 2 Σ cos ω(x − x'): neither depth nor background has to be known.
"""

import numpy as np

from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import irf_spectrum, progression

RUNGS = 20      # frequencies at which photons and IRF are compared
POOLED_PIXELS = 4      # pixels that count as one: a reconstruction pools the photons around each point
MOST_OFF = 0.08     # relative difference of |ĥ|² by photons and by IRF; frequencies above it add to the depth error


def measure(frame, sensor, gate, highest: int) -> tuple[float, int]:
    """How much signal the photons in the gate have.

    Returns:
        The score p √(2n) of the n photons of POOLED_PIXELS, and the highest frequency at which photons and IRF agree.
    """
    sketch = sketch_photons(frame, sensor, progression(highest, min(RUNGS, highest)), gate)
    within = sketch.sensor
    passed = np.square(np.abs(np.atleast_2d(irf_spectrum(within, sketch.frequencies)))).mean(axis=0)
    passed *= np.sinc(np.array(sketch.frequencies) / within.num_bins)       # depths lie between bins
    several = (sketch.photons > 1) & sensor.used
    n = sketch.photons[several].astype(np.float64)[:, None]
    # Divide by n − 1: each pixel then counts by its photons, not by its pairs.
    pairs = ((np.abs(sketch.sums[several])**2 - n) / (n - 1)).sum(axis=0) / max(n.sum(), 1)
    error = np.sqrt((n / (n - 1)).sum()) / max(n.sum(), 1)
    share2 = max(pairs @ passed / (passed @ passed), 1e-12)
    wrong = np.append(np.abs(pairs / share2 - passed) + error / share2 > MOST_OFF * passed, True)
    score = np.sqrt(2 * POOLED_PIXELS * min(share2, 1) * sketch.photons.mean(where=sensor.used))
    return float(score), (0, *sketch.frequencies)[wrong.argmax()]
