"""Deskewer: sketches of a sensor that moved, moved to where they would be seen from at one instant, and added up.

A surface at range ρ along a pixel's ray d, seen at some instant, lies at X = ρ R d + p in the sensor's frame at another
one. There the pixels that look at X see it, and |X| − ρ farther away, which is exactly a factor exp(i ω_l Δ) of the
sums for Δ bins. The photons go to where X is, instead of each pixel's asking where its photons were: so none is lost
but those that leave the array, none counts twice, and a surface behind another does not shine through. The four pixels
around share them (if the nearest had all, depth errors were 15 to 25 % larger), each as if the surface had been seen
at its own place: along the surface of the last cloud, not across its edges.
"""

from collections.abc import Sequence

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import MAX_PHOTONS, Sketch, check_frequencies
from srt3d_ros.errors import require

TINY = 1e-9             # photons that are divided by at least
FAR_M = 100.0           # what is at no known range: its parallax in a frame is less than a pixel
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
        self._lens = sensor.projection.lens
        self._bin_frequencies = (np.array(self.frequencies) / sensor.num_bins).astype(np.float32)
        apart = np.linalg.norm(np.diff(sensor.rays, axis=1), axis=-1)
        self._steepest = STEEPEST * float(np.median(apart)) if apart.size else 0.0
        self._rounding = np.tile(ROUNDING, (-(-rows // 4), -(-cols // 4)))[:rows, :cols]

    def __call__(self, parts: Parts, trajectory: Trajectory, to_ns: int, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of all parts as it would be had all their photons come at `to_ns`.

        Args:
            parts: their instants, the middle of acquisition, and their sketches.
            trajectory: of the sensor's frame, over all instants.
            to_ns: the instant, and the stamp of the result.
            range_m: float32 [rows, cols], metres along each pixel's ray at `to_ns`, NaN where unknown, taken for the
                median of the others. None: all photons move as from FAR_M: the rotation is right, without parallax.

        Raises:
            InvalidInput: the trajectory does not cover an instant, or the sketches are not the sensor's.
        """
        ranges, back, came = self._filled(range_m), trajectory.at(to_ns).inverse(), 0
        sums = np.zeros((*self._shape, len(self.frequencies)), np.complex64)
        photons = np.zeros(self._shape, np.float32)
        for instant_ns, sketch in parts:
            shape = tuple(sketch.photons.shape)
            require(shape == self._shape and sketch.frequencies == self.frequencies, "sketch",
                    f"{shape}, {sketch.frequencies}", f"{self._shape}, {self.frequencies}")
            motion = back @ trajectory.at(instant_ns)
            self._kernels.move_sketch(sketch.sums, sketch.photons.astype(np.float32), self._used, self.sensor.rays,
                                      ranges, motion.rotation.astype(np.float32), motion.translation.astype(np.float32),
                                      self._lens, self._bin_frequencies, self._late, self.sensor.bin_width_m,
                                      self._steepest, sums, photons)
            came += int(sketch.photons.sum(dtype=np.int64, where=self._used))
        self.lost = max(came - round(float(photons.sum(dtype=np.float64))), 0)
        whole = np.minimum(np.floor(photons.astype(np.float64) + self._rounding), MAX_PHOTONS)
        sums *= self._phases(ranges) * (whole / np.maximum(photons, TINY)).astype(np.float32)[..., None]
        return Sketch(self.frequencies, sums, whole.astype(np.uint32), to_ns,
                      max((sketch.added_variance for _, sketch in parts), default=0.0))

    def _filled(self, range_m: np.ndarray | None) -> np.ndarray:
        """Ranges of all pixels, float32 [rows, cols]."""
        ranges = np.full(self._shape, np.nan, np.float32) if range_m is None else np.asarray(range_m, np.float32)
        require(ranges.shape == self._shape, "range_m shape", ranges.shape, f"[rows, cols] = {self._shape}")
        known = np.isfinite(ranges) & (ranges > 0)
        return np.where(known, ranges, np.median(ranges[known]) if known.any() else np.float32(FAR_M))

    def _phases(self, ranges: np.ndarray) -> np.ndarray:
        """exp(i ω_l t) of the depths t of ranges, complex64 [rows, cols, m]: `move_sketch` leaves them out."""
        depth = ranges / np.float32(self.sensor.bin_width_m) + self._late
        turns = depth[..., None] * self._bin_frequencies
        angle = (turns - np.rint(turns)) * np.float32(2 * np.pi)
        phases = np.empty(turns.shape, np.complex64)
        phases.real, phases.imag = np.cos(angle), np.sin(angle)
        return phases


def moved_ranges(depth: np.ndarray, sensor: SensorModel, motion: Pose) -> np.ndarray:
    """The range along each pixel's ray after a motion; float32 [rows, cols], metres, NaN where it is not known.

    Args:
        depth: float32 [rows, cols], as a depth image shows it before the motion (REP-118: z of a pinhole, range of a
            scanner; NaN or 0 = none).
        motion: of a point in the sensor's frame, from then to now.

    Raises:
        InvalidInput: a depth image of another size.
    """
    require(depth.shape == (sensor.rows, sensor.cols), "depth image", f"{depth.shape} pixels",
            f"{sensor.rows} × {sensor.cols} pixels")
    seen = np.isfinite(depth) & (depth > 0)
    rays, along = sensor.rays[seen], depth[seen]
    if isinstance(sensor.projection, Pinhole):
        along = along / rays[:, 2]
    return range_image(sensor, motion(rays * along[:, None]))


def range_image(sensor: SensorModel, xyz: np.ndarray) -> np.ndarray:
    """Range of the nearest of points [N, 3] that each pixel sees, float32 [rows, cols], metres; NaN where none."""
    row, col = (np.floor(place + 0.5) for place in sensor.projection.places(xyz))
    seen = (row >= 0) & (row < sensor.rows) & (col >= 0) & (col < sensor.cols)      # not NaN
    pixel = row[seen].astype(np.int64) * sensor.cols + col[seen].astype(np.int64)
    nearest = np.full((sensor.rows, sensor.cols), np.inf, np.float32)
    range_m = np.linalg.norm(xyz[seen].astype(np.float32), axis=1)
    np.minimum.at(nearest.reshape(-1), pixel, range_m)      # one index and one dtype: fifty times faster
    return np.where(np.isfinite(nearest), nearest, np.float32(np.nan))
