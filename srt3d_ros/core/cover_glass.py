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
    sensor, depth = cloud.sensor, cloud.depth_bins
    seen = sketch.photons[(sketch.photons > 0) & sensor.used]
    if cloud.surfaces > 1 or len(cloud) < max(NEARLY_ALL * len(seen), FEWEST_PIXELS):
        return ""
    if sensor.background_shape is not None or 0 < sketch.cycles * FULL < np.median(seen):
        return ""
    plane = float(np.median(depth[::-(-len(depth) // MOST_PIXELS)]))
    there = np.flatnonzero(np.abs(depth - plane) <= max(rms_width(sensor), 1))
    share = min(len(there) / len(seen), 1)
    if share < NEARLY_ALL:
        return ""
    some = there[::-(-len(there) // MOST_PIXELS)]
    pixel = cloud.pixel[some]
    spectrum = np.broadcast_to(irf_spectrum(sensor, sketch.frequencies), (sensor.pixels, len(sketch.frequencies)))
    energy = np.square(np.abs(spectrum[pixel])).mean(axis=0)
    low = np.flatnonzero(energy >= min(LOW, np.sort(energy)[-2:].min()))
    omega, at = angular_frequencies(sketch.frequencies, sensor.num_bins)[low], (pixel[:, None], low)
    model = spectrum[at] * np.exp(1j * np.outer(depth[some] + sensor.late.reshape(-1)[pixel], omega))
    sums = sketch.sums.reshape(spectrum.shape)[at]
    photons = sketch.photons.reshape(-1)[pixel].astype(np.float64)
    fitted = np.real(model.conj() * sums).sum(axis=1) / np.square(np.abs(model)).sum(axis=1)
    blocks = np.arange(0, len(some), TOGETHER)
    rest, of_plane, n = (np.add.reduceat(values, blocks) for values in (
        sums - fitted[:, None] * model, fitted[:, None] * np.abs(model), photons))
    more = np.square(np.abs(rest)).sum() - len(low) * n.sum()
    if more < max(MORE_ENERGY * np.square(of_plane).sum(), MORE_SIGMAS * np.sqrt(len(low) * np.square(n).sum())):
        return ""
    return (f"{share:.0%} of the pixels have their point at {sensor.range_m(plane):.3g} m, and more photons at other "
            "depths: if that is a cover glass or a window, surfaces of 2 show what is behind")
