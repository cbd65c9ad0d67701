"""Whether the photons of surfaces are spread over the bins as the IRF says."""

import numpy as np

from srt3d_ros.core.method.matched_frame import CORRECTED, Matcher, uncorrected
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.sums import PhaseSums

MOST_PIXELS = 1024      # looked at
# Of the spectrum, left unexplained. Measured IRFs leave 0.00 to 0.03 (five real scenes), a tail of 10 % that they lack
# 0.04 (depths err by 0.2 bins), one of 30 % 0.10 to 0.15 (by 0.4 to 0.7 bins), an IRF that is wrong by half 0.16.
LEFT = 0.07
SURE = 6.0      # χ² per degree of freedom: points that noise has chosen leave up to 3 (exact IRF, 1 photon, SBR of 0.1)


def misplaced_share(matcher: Matcher, sketch: PhaseSums, cloud: PointCloud) -> float:
    """Share of the photons of surfaces that are not where the IRF puts them; 0 if that is not sure, or harmless.

    Over pixels with one point, at t, the sums of conj(ĥ_l) z_l exp(−i ω_l t) are R |ĥ_l|² on average, R signal photons,
    if the IRF is right and the background even. What is left of them is what no correction of intensity, depth, width
    and skew explains (`uncorrected`).
    """
    sensor, energy, m = cloud.sensor, matcher.energy.astype(np.float64), len(matcher.frequencies)
    some = np.arange(len(cloud))
    if cloud.surface.any():
        pixel = cloud.pixel
        some = np.flatnonzero(np.bincount(pixel, minlength=1)[pixel] == 1)
    some, free = some[::len(some) // MOST_PIXELS + 1], m - min(max(m // 2, 2), CORRECTED) / 2
    if len(some) == 0 or free < 1:
        return 0.0
    row, col, omega = cloud.row[some], cloud.col[some], matcher.omega
    equaliser = np.broadcast_to(matcher.equaliser, sketch.sums.shape)[row, col]
    turn, noise = np.outer(cloud.depth_bins[some], omega).astype(np.float32), float(sketch.photons[row, col].sum())
    shown = (equaliser * sketch.sums[row, col] * (np.cos(turn) - 1j * np.sin(turn))).sum(axis=0)
    root = np.sqrt(energy)
    left = float(np.square(np.abs(uncorrected(shown / root, matcher.corrections))).sum())
    least = LEFT**2 * float(np.square(np.abs(shown / root)).sum())
    if left < SURE * noise * free or left - noise * free < least:
        return 0.0
    exposure, lowest = (sensor.exposure * sketch.frames)[row, col], np.argmin(omega)
    explained = (cloud.intensity[some] * exposure).sum()
    return max(1 - float(explained * energy[lowest] / np.abs(shown[lowest])), 0.0)      # where a tail is in phase
