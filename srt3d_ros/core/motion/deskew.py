"""Deskewer: sketches of a sensor that moved, moved to where they would be seen from at one instant, and added up.

A surface at range ρ along a pixel's ray d, seen at some instant, lies at X = ρ R d + p in the sensor's frame at another
one. There the pixels that look at X see it, and |X| − ρ farther away, which is exactly a factor exp(i ω_l Δ) of the
sums for Δ bins. The photons go to where X is, instead of each pixel's asking where its photons were: so none is lost
but those that leave the array, none counts twice, and a surface behind another does not shine through. The four pixels
around share them (if the nearest had all, depth errors were 15 to 25 % larger), each as if the surface had been seen
at its own place: along the surface, not across its edges.

The range ρ comes from the photons themselves: the phase of the lowest frequency, to which an even background adds
nothing, of so many pixels around that neighbours' ranges do not differ by noise, which would part their photons.
"""

from collections.abc import Sequence

import numpy as np

from srt3d_ros.core.devices import kernels_for
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import irf_spectrum
from srt3d_ros.core.sketching.sketch import MAX_PIXEL_PHOTONS, Sketch, added_cycles, check_frequencies

TINY = 1e-9             # photons that are divided by at least
FAR_M = 100.0           # range without frequency 1: its parallax in a frame is less than a pixel
NEAREST_M = 0.3         # where noise or a second surface says less
RANGE_NOISE = 0.05      # of the pulse: standard deviation from pixel to pixel. Half or twice as much changes < 1 %
STEEPEST = 6.0          # tangent of the incidence, 80°, beyond which neighbouring pixels see two surfaces
# Where the parts of photons round up, in each 4 × 4 pixels (Bayer, ICC 1973): as many up as down, however few there are
ROUNDING = (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], np.float32) + 0.5) / 16
Parts = Sequence[tuple[int, Sketch]]


class Deskewer:
    """Moves sketches of one sensor.

    Masked pixels give no photons; pixels' delays are corrected. What a pixel's photons are worth by its `gain`, or look
    like by an IRF of its own, is not: where pixels differ much, intensities are those of a mixture.

    Args:
        sensor: that of the sketches: `gate.sensor` under a gate.
        frequencies: the integers k_l.

    Attributes:
        lost: photons of the last call that no pixel sees any more; those of masked pixels do not count.
    """

    def __init__(self, sensor: SensorModel, frequencies):
        self.sensor, self.lost = sensor, 0
        self.frequencies = check_frequencies(frequencies, sensor.num_bins)
        _, self._kernels = kernels_for("cpu")
        rows, cols = self._shape = sensor.rows, sensor.cols
        self._late = np.zeros(self._shape, np.float32) if sensor.delay_bins is None else sensor.delay_bins
        self._used = np.ones(self._shape, bool) if sensor.mask is None else sensor.mask
        self._bin_frequencies = (np.array(self.frequencies) / sensor.num_bins).astype(np.float32)
        apart = np.linalg.norm(np.diff(sensor.rays, axis=1), axis=-1)
        self._steepest = STEEPEST * float(np.median(apart)) if apart.size else 0.0
        self._rounding = np.tile(ROUNDING, (-(-rows // 4), -(-cols // 4)))[:rows, :cols]

    def __call__(self, parts: Parts, trajectory: Trajectory, to_ns: int, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of all parts as it would be had all their photons come at `to_ns`.

        Args:
            parts: their instants, the middle of acquisition, and their sketches.
            trajectory: of the sensor's frame, over all instants, or InvalidInput.
            to_ns: the instant, and the stamp of the result.
            range_m: float32 [rows, cols], metres along each pixel's ray; unless given, what the photons show.
        """
        ranges, back, came = self.ranges_m(parts) if range_m is None else range_m, trajectory.at(to_ns).inverse(), 0
        sums = np.zeros((*self._shape, len(self.frequencies)), np.complex64)
        photons = np.zeros(self._shape, np.float32)
        scene = self._kernels.Scene(self._used, self.sensor.rays, ranges, self._late, self._bin_frequencies,
                                    self.sensor.bin_width_m, self._steepest)
        for instant_ns, sketch in parts:
            pose = back @ trajectory.at(instant_ns)
            motion = self._kernels.Motion(pose.rotation.astype(np.float32), pose.translation.astype(np.float32))
            self._kernels.move_sketch(sketch.sums, sketch.photons.astype(np.float32), scene,
                                      self.sensor.projection.lens, motion, sums, photons)
            came += int(sketch.photons.sum(dtype=np.int64, where=self._used))
        self.lost = max(came - round(float(photons.sum(dtype=np.float64))), 0)
        whole = np.minimum(np.floor(photons.astype(np.float64) + self._rounding), MAX_PIXEL_PHOTONS)
        sums *= self._phases(ranges) * (whole / np.maximum(photons, TINY)).astype(np.float32)[..., None]
        return Sketch(self.frequencies, sums, whole.astype(np.uint32), to_ns,
                      *added_cycles([sketch for _, sketch in parts]), sensor=self.sensor)

    def ranges_m(self, parts: Parts) -> np.ndarray:
        """The range along each pixel's ray by the photons of it and its neighbours; float32 [rows, cols], metres."""
        if 1 not in self.frequencies:
            return np.full(self._shape, FAR_M, np.float32)
        from scipy.ndimage import gaussian_filter  # here: only moving sensors need it

        first, sensor = self.frequencies.index(1), self.sensor
        bins_a_radian = sensor.num_bins / (2 * np.pi)
        back = np.exp(-1j * self._late / bins_a_radian) * np.conj(irf_spectrum(sensor, (1,)).mean()) * self._used
        z = sum(sketch.sums[..., first] for _, sketch in parts) * back
        photons = sum(float(sketch.photons.sum()) for _, sketch in parts)
        noise = np.sqrt(photons * z.size / 2) / max(abs(z.sum()), TINY) * bins_a_radian         # of a pixel, bins
        pulse = 1 / float(np.square(np.atleast_2d(sensor.irf).mean(axis=0)).sum())
        # Between neighbours of a Gaussian mean, noise is less by √(8π) sigma².
        sigma = min(np.sqrt(noise / (np.sqrt(8 * np.pi) * RANGE_NOISE * pulse)), max(self._shape))
        mean = gaussian_filter(z.real, sigma) + 1j * gaussian_filter(z.imag, sigma)
        depth = np.mod(np.angle(mean), 2 * np.pi) * bins_a_radian
        return np.maximum(sensor.range_m(depth), NEAREST_M).astype(np.float32)

    def _phases(self, ranges: np.ndarray) -> np.ndarray:
        """exp(i ω_l t) of the depths t of ranges, complex64 [rows, cols, m]: `move_sketch` leaves them out."""
        depth = ranges / np.float32(self.sensor.bin_width_m) + self._late
        turns = depth[..., None] * self._bin_frequencies
        angle = (turns - np.rint(turns)) * np.float32(2 * np.pi)
        phases = np.empty(turns.shape, np.complex64)
        phases.real, phases.imag = np.cos(angle), np.sin(angle)
        return phases
