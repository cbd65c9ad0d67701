"""Whether all pixels see one plane, a cover glass or a window, that hides the scene from a cloud of one surface."""

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.pulse import rms_width
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sketching.sums import PhaseSums

NEARLY_ALL = 0.9            # of the pixels at one depth
FEWEST_PIXELS, MOST_PIXELS = 16, 1024       # looked at
LOW = 0.8                   # |ĥ|², least: an IRF 10 % too wide leaves 0.05 % of the energy there
TOGETHER = 32               # neighbours in a row, whose photons are added up: what they see lies at about one depth
MORE_ENERGY = 0.01          # of the plane's, in the rest: another surface with an eighth of its photons
MORE_SIGMAS = 6.0           # of the photons' noise, in the rest
FULL = 0.05                 # photons a cycle; more bend the background by pile-up


def hidden_scene(sketch: PhaseSums, cloud: PointCloud) -> str:
    """A warning if nearly all pixels have their only point at one depth, and their photons show that there is more.

    What a plane and an even background leave of sketches, once the plane is fitted in each pixel, has the energy of the
    photons' noise, their number n. Nothing is said where the background is known to be uneven.
    """
    sensor, kept = cloud.sensor, sketch.photons > 0
    if sensor.background_shape is not None or 0 < sketch.cycles * FULL < np.median(sketch.photons[kept & sensor.used]):
        return ""
    pixels, depth = int(np.count_nonzero(kept & sensor.used)), cloud.depth_bins
    if len(cloud) < max(NEARLY_ALL * pixels, FEWEST_PIXELS) or cloud.surfaces > 1:
        return ""
    plane = float(np.median(depth[::-(-len(depth) // MOST_PIXELS)]))
    there = np.flatnonzero(np.abs(depth - plane) <= max(rms_width(sensor), 1))
    if len(there) < NEARLY_ALL * pixels:
        return ""
    some = there[::-(-len(there) // MOST_PIXELS)]
    row, col = cloud.row[some].astype(np.int64), cloud.col[some].astype(np.int64)
    spectrum = np.atleast_2d(irf_spectrum(sensor, sketch.frequencies))
    energy = np.square(np.abs(spectrum)).mean(axis=0)
    low = np.flatnonzero(energy >= min(LOW, np.sort(energy)[-2:].min()))
    omega = angular_frequencies(sketch.frequencies, sensor.num_bins)[low]
    at = np.where(len(spectrum) > 1, row * sensor.cols + col, 0)
    model = spectrum[at[:, None], low] * np.exp(1j * np.outer(depth[some] + sensor.late[row, col], omega))
    sums, photons = sketch.sums[row[:, None], col[:, None], low], sketch.photons[row, col].astype(np.float64)
    fitted = np.real(model.conj() * sums).sum(axis=1) / np.square(np.abs(model)).sum(axis=1)
    blocks = np.arange(0, len(some), TOGETHER)
    rest, of_plane, n = (np.add.reduceat(values, blocks) for values in (
        sums - fitted[:, None] * model, fitted[:, None] * np.abs(model), photons))
    more = np.square(np.abs(rest)).sum() - len(low) * n.sum()
    if more < max(MORE_ENERGY * np.square(of_plane).sum(), MORE_SIGMAS * np.sqrt(len(low) * np.square(n).sum())):
        return ""
    share = min(len(there) / pixels, 1)
    return (f"{share:.0%} of the pixels have their point at {sensor.range_m(plane):.3g} m, and more photons at other "
            "depths: if that is a cover glass or a window, surfaces of 2 show what is behind")
