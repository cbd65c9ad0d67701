"""How much signal the photons of a frame have, and up to which frequency they are as the IRF says.

Two signal photons of a pixel lie apart as two draws of the IRF do, at whatever depth; a background photon lies
anywhere. So the mean of cos ω(x − x') over the pairs of photons of a pixel is p² |ĥ(ω)|², p the share of the signal. A
sketch has their sum, |Σ_x exp(i ω x)|² = n + 2 Σ cos ω(x − x'): no depth and no background has to be known.
"""

import numpy as np

from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import irf_spectrum, progression

RUNGS = 20      # frequencies at which photons and IRF are compared
POOLED = 4      # pixels whose photons count together: a reconstruction pools those around each point
DOUBT = 0.08    # relative difference between the photons' |ĥ|² and the IRF's; above, higher k add to the depth error


def measure(frame, sensor, gate, highest: int) -> tuple[float, int]:
    """The score p √(2n) of n photons, those of POOLED pixels in the gate; the k ≤ highest up to which the IRF holds."""
    sketch = sketch_photons(frame, sensor, progression(highest, min(RUNGS, highest)), gate)
    within, mask = sketch.sensor, True if sensor.mask is None else sensor.mask
    passed = np.square(np.abs(np.atleast_2d(irf_spectrum(within, sketch.frequencies)))).mean(axis=0)
    passed *= np.sinc(np.array(sketch.frequencies) / within.num_bins)       # depths lie between bins
    several = (sketch.photons > 1) & mask
    n = sketch.photons[several].astype(np.float64)[:, None]
    # of each photon the mean over the others of its pixel: a bright pixel weighs as its photons, not as its pairs
    pairs = ((np.abs(sketch.sums[several])**2 - n) / (n - 1)).sum(axis=0) / max(n.sum(), 1)
    error = np.sqrt((n / (n - 1)).sum()) / max(n.sum(), 1)
    share2 = max(pairs @ passed / (passed @ passed), 1e-12)
    wrong = np.append(np.abs(pairs / share2 - passed) + error / share2 > DOUBT * passed, True)
    score = np.sqrt(2 * POOLED * min(share2, 1) * sketch.photons.mean(where=mask))
    return float(score), (0, *sketch.frequencies)[wrong.argmax()]
