"""Deskewer: moves sketches of a moving sensor to its pose at one instant, and adds them up.

A surface at range ρ along a pixel's ray d lies at X = ρ R d + p in the sensor's frame at the other instant. The pixels
that look at X see it |X| − ρ farther away: a shift of Δ bins multiplies the sums by exp(i ω_l Δ). Photons are pushed to
X, not pulled by each pixel. So photons are lost only where they leave the array, none counts twice, and a surface
behind another does not shine through. They are split among the four pixels around X (depth errors are 15 to 25 % larger
if the nearest takes all). Each pixel gets the depth that the surface has there; none are split across an edge.

The range ρ comes from the photons: the phase of the lowest frequency, to which an even background adds nothing. It is
averaged over enough pixels that noise does not give neighbours different ranges, which would scatter their photons.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.pulse import equivalent_width
from srt3d_ros.core.sketching.frequencies import irf_spectrum
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, PhaseSums, added_cycles
from srt3d_ros.kernels.devices import kernels_for

LEAST_PHOTONS = 1e-9    # avoids division by 0
FAR_M = 100.0           # range used without frequency 1: its parallax within a frame is less than a pixel
NEAREST_M = 0.3         # lower limit of ranges, against noise and second surfaces
RANGE_NOISE = 0.05      # noise allowed between ranges, as a fraction of the pulse width; half or double changes < 1 %
STEEPEST = 6.0          # tangent of the incidence angle, 80°, beyond which neighbouring pixels see two surfaces
# Ordered dither (Bayer, ICC 1973): fractions of photons round up in as many of 4 × 4 pixels as down, however few.
DITHER = (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], np.float32) + 0.5) / 16
Parts = Sequence[tuple[int, PhaseSums]]


class Deskewer:
    """Moves sketches of one sensor.

    Masked pixels give no photons, and delays are corrected. Gain and IRFs per pixel are not: where they differ,
    intensities are mixed.

    Args:
        sensor: of the sketches: `gate.sensor` if there is a gate.
        frequencies: the integers k_l.

    Attributes:
        lost: photons of the last call that left the array, without those of masked pixels.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int]):
        self.sensor, self.lost = sensor, 0
        self.frequencies = tuple(frequencies)
        self._kernels = kernels_for("cpu")
        rows, cols = self._shape = sensor.shape
        self._bin_frequencies = (np.array(self.frequencies) / sensor.num_bins).astype(np.float32)
        apart = np.linalg.norm(np.diff(sensor.rays, axis=1), axis=-1)
        self._steepest = STEEPEST * float(np.median(apart)) if apart.size else 0.0
        self._dither = np.tile(DITHER, (math.ceil(rows / 4), math.ceil(cols / 4)))[:rows, :cols]

    def __call__(self, parts: Parts, trajectory: Trajectory, to_ns: int, range_m: np.ndarray | None = None
                 ) -> PhaseSums:
        """The sketch as if all photons had come at `to_ns`.

        Args:
            parts: the instant of each part, the middle of its acquisition, and its sketch.
            trajectory: of the sensor's frame; InvalidInput unless it covers all instants.
            to_ns: the instant, and the stamp of the result.
            range_m: float32 [rows, cols], metres along each pixel's ray; from the photons unless given.
        """
        ranges, back = self.ranges_m(parts) if range_m is None else range_m, trajectory.at(to_ns).inverse()
        sums, photons = self.moved([(back @ trajectory.at(instant_ns), sketch.sums, sketch.photons.astype(np.float32))
                                    for instant_ns, sketch in parts], ranges)
        came = sum(int(sketch.photons.sum(dtype=np.int64, where=self.sensor.used)) for _, sketch in parts)
        self.lost = max(came - round(float(photons.sum(dtype=np.float64))), 0)
        sums, whole = self.whole(sums, photons)
        return PhaseSums(self.frequencies, sums, whole, to_ns, *added_cycles([sketch for _, sketch in parts]),
                         sensor=self.sensor)

    def moved(self, parts: Sequence[tuple[Pose, np.ndarray, np.ndarray]], ranges: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray]:
        """Sums and photons of parts after the motion of each, added up.

        Args:
            parts: motions of the sensor, from X before to X after; sums, complex64 [rows, cols, m + k], where k further
                maps move with the sums, but do not turn; and photons, float32 [rows, cols], without which nothing of a
                pixel moves.
            ranges: after the motions, float32 [rows, cols], metres.
        """
        sensor, (_, sums, _) = self.sensor, parts[0]
        turning = np.zeros(sums.shape[2], np.float32)
        turning[:len(self.frequencies)] = self._bin_frequencies
        scene = self._kernels.SeenScene(sensor.used, sensor.rays, ranges, sensor.late, turning, sensor.bin_width_m,
                                        self._steepest)
        return self._kernels.move_sketches([(self._motion(pose), *rest) for pose, *rest in parts], scene,
                                           sensor.projection.lens)

    def whole(self, sums: np.ndarray, photons: np.ndarray, scale: np.ndarray | int = 1
              ) -> tuple[np.ndarray, np.ndarray]:
        """Sums of scale · photons, rounded to whole ones, and these, uint32 [rows, cols]."""
        whole = np.minimum(np.floor(photons.astype(np.float64) * scale + self._dither), MAX_PIXEL_PHOTONS)
        share = (whole / np.maximum(photons, LEAST_PHOTONS)).astype(np.float32)
        # as real numbers: products of complex ones take three times as long
        return (sums.view(np.float32) * share[..., None]).view(np.complex64), whole.astype(np.uint32)

    def _motion(self, pose: Pose) -> Any:
        return self._kernels.Motion(pose.rotation.astype(np.float32), pose.translation.astype(np.float32))

    def ranges_of(self, cloud: PointCloud, pose: Pose) -> np.ndarray | None:
        """The ranges at which a cloud's first points are seen after a motion, as of `ranges_m`; None if none is."""
        xyz = cloud.xyz[cloud.surface == 0] if cloud.surface.any() else cloud.xyz       # a copy takes long
        ranges = self._kernels.seen_ranges(xyz, self._motion(pose), self.sensor.projection.lens, self._shape)
        return None if np.isinf(ranges[0, 0]) else np.maximum(ranges, NEAREST_M)

    def ranges_m(self, parts: Parts) -> np.ndarray:
        """The range along each pixel's ray, by its photons and its neighbours'; float32 [rows, cols], metres."""
        if 1 not in self.frequencies:
            return np.full(self._shape, FAR_M, np.float32)
        from scipy.ndimage import gaussian_filter  # here: only moving sensors need SciPy

        first, sensor = self.frequencies.index(1), self.sensor
        bins_a_radian = sensor.num_bins / (2 * np.pi)
        back = np.exp(-1j * sensor.late / bins_a_radian) * np.conj(irf_spectrum(sensor, (1,)).mean()) * sensor.used
        z = sum(sketch.sums[..., first] for _, sketch in parts) * back
        photons = sum(float(sketch.photons.sum()) for _, sketch in parts)
        noise = np.sqrt(photons * z.size / 2) / max(abs(z.sum()), LEAST_PHOTONS) * bins_a_radian     # of a pixel, bins
        pulse = equivalent_width(sensor)
        # A Gaussian mean divides the noise between neighbours by √(8π) σ².
        sigma = min(np.sqrt(noise / (np.sqrt(8 * np.pi) * RANGE_NOISE * pulse)), max(self._shape))
        depth = np.mod(np.angle(gaussian_filter(z, sigma)), 2 * np.pi) * bins_a_radian
        return np.maximum(sensor.range_m(depth), NEAREST_M).astype(np.float32)
