"""Deskewer: sketches of a sensor that moved, moved to where they would be seen from at one instant, and added up.

A surface at range ρ along a pixel's ray d, seen at some instant, lies at X = ρ R d + p in the sensor's frame at another
one. There the pixels that look at X see it, and |X| − ρ farther away, which is exactly a factor exp(i ω_l Δ) of the
sums for Δ bins. The photons go to where X is, instead of each pixel's asking where its photons were: so none is lost
but those that leave the array, none counts twice, and a surface behind another does not shine through. The four pixels
around share them (if the nearest had all, depth errors were 15 to 25 % larger), each as if the surface had been seen
at its own place: along the surface of the last cloud, not across its edges.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from srt3d_ros.core.device import kernels_for, on_host
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import MAX_PHOTONS, Sketch, check_frequencies
from srt3d_ros.errors import require

TINY = 1e-9             # photons that are divided by at least
MOST_GROUPS = 64        # of pixels that look at about the same time: at 30°/s and 100 ms, 0.05° apart
FAR_M = 100.0           # what is at no known range: its parallax in a frame is less than a pixel
STEEPEST = 6.0          # tangent of the incidence, 80°, beyond which neighbouring pixels see two surfaces
SMOOTHED = 2            # pixels to both sides: unsmoothed, the error of ten frames' window is 1.7 × as large (10 ppp)
# Where the parts of photons round up, in each 4 × 4 pixels (Bayer, ICC 1973): as many up as down, however few there are
ROUNDING = (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]], np.float32) + 0.5) / 16
Parts = Sequence[tuple[int, Sketch]]
Moved = tuple[Any, Any]         # sums and numbers of `move_sketch`


class Deskewer:
    """Moves sketches of one sensor.

    Masked pixels give no photons; pixels' delays are corrected. What a pixel's photons are worth by its `gain`, or look
    like by an IRF of its own, is not: where pixels differ much, intensities are those of a mixture. Photons from ranges
    that are not known move as from far away: the rotation is right, and the parallax left out.

    Args:
        sensor: that of the sketches: `gate.sensor` under a gate.
        frequencies: the integers k_l.
        device: "cpu" or "cuda".

    Attributes:
        lost: photons of the last call that no pixel sees any more; those of masked pixels do not count.
    """

    def __init__(self, sensor: SensorModel, frequencies, device: str = "cpu"):
        self.sensor, self.lost = sensor, 0
        self.frequencies = check_frequencies(frequencies, sensor.num_bins)
        _, self._kernels = kernels_for(device)
        on, shape = self._kernels.array, (sensor.rows, sensor.cols)
        self._rays, self._lens = on(sensor.rays), on(sensor.projection.lens)
        self._late = on(np.zeros(shape, np.float32) if sensor.delay_bins is None else sensor.delay_bins.copy())
        self._used_on_host = np.ones(shape, bool) if sensor.mask is None else sensor.mask
        self._used = on(self._used_on_host.astype(np.float32))
        self._bin_frequencies = on((np.array(self.frequencies) / sensor.num_bins).astype(np.float32))
        apart = np.linalg.norm(np.diff(sensor.rays, axis=1), axis=-1)
        self._steepest = STEEPEST * float(np.median(apart)) if apart.size else 0.0
        self._together, self._all = np.zeros(1, np.int64), on(np.zeros(shape, np.uint8))
        self._group = self._all
        if (times := sensor.pixel_times_s) is not None:
            self._together, group = _in_groups(np.asarray(times))
            self._group = on(group)

    def __call__(self, parts: Parts, trajectory: Trajectory, to_ns: int, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of all parts as it would be had all their photons come at `to_ns`.

        Args:
            parts: their instants, and their sketches: the middle of acquisition, or the stamp that pixels' own times
                count from if the sensor has these.
            trajectory: of the sensor's frame, over all instants.
            to_ns: the instant, and the stamp of the result.
            range_m: float32 [rows, cols], metres along each pixel's ray at `to_ns`, NaN where unknown; None: nowhere.

        Raises:
            InvalidInput: the trajectory does not cover an instant, or the sketches are not the sensor's.
        """
        return self.rounded(self.add_up(parts, trajectory, to_ns, self.filled(range_m)))

    def add_up(self, parts: Parts, trajectory: Trajectory, to_ns: int, ranges: Any) -> Sketch:
        """The same by ranges of `filled`, with parts of photons (float32) as they are shared."""
        moved, back, came = self.nothing(), trajectory.at(to_ns).inverse(), 0
        for instant_ns, sketch in parts:
            poses = [back @ trajectory.at(int(instant_ns + late_ns)) for late_ns in self._together]
            self._move(sketch, poses, self._group, ranges, moved)
            came += int(on_host(sketch.photons).sum(dtype=np.int64, where=self._used_on_host))
        self.lost = max(came - round(float(on_host(moved[1]).sum(dtype=np.float64))), 0)
        return self.read(moved, ranges, to_ns, max((sketch.added_variance for _, sketch in parts), default=0.0))

    def move(self, sketch: Sketch, motion: Pose, ranges: Any) -> Moved:
        """Photons of one instant, of all pixels, after a motion."""
        moved = self.nothing()
        self._move(sketch, [motion], self._all, ranges, moved)
        return moved

    def nothing(self) -> Moved:
        """Sums and numbers without photons."""
        shape = self.sensor.rows, self.sensor.cols
        return self._on(np.zeros((*shape, len(self.frequencies)), np.complex64)), self._on(np.zeros(shape, np.float32))

    def read(self, moved: Moved, ranges: Any, to_ns: int, added_variance: float = 0.0) -> Sketch:
        """The sketch of photons that have been moved, all with the same ranges; with parts of photons."""
        sums, numbers = moved
        sums = self._kernels.read_moved(sums, ranges, self._late, self._bin_frequencies, self.sensor.bin_width_m)
        return Sketch(self.frequencies, on_host(sums), on_host(numbers), to_ns, added_variance)

    def rounded(self, sketch: Sketch) -> Sketch:
        """The same mean of whole photons, uint32."""
        rows, cols = sketch.photons.shape
        up = np.tile(ROUNDING, (-(-rows // len(ROUNDING)), -(-cols // len(ROUNDING))))[:rows, :cols]
        whole = np.minimum(np.floor(sketch.photons.astype(np.float64) + up), MAX_PHOTONS)
        scale = (whole / np.maximum(sketch.photons, TINY)).astype(np.float32)
        sums = (sketch.sums.view(np.float32) * scale[..., None]).view(np.complex64)
        return replace(sketch, sums=sums, photons=whole.astype(np.uint32))

    def filled(self, range_m: np.ndarray | None) -> Any:
        """Ranges of all pixels, smoothed, on the device; FAR_M if none is known.

        Where one is unknown it is that of the farther neighbour of the next in the row that are known, or in the column
        where a row knows nothing: what a motion uncovers is more often part of what is behind.
        """
        shape = self.sensor.rows, self.sensor.cols
        ranges = np.full(shape, FAR_M, np.float32) if range_m is None else np.asarray(range_m, np.float32)
        require(ranges.shape == shape, "range_m shape", ranges.shape, f"[rows, cols] = {shape}")
        known = np.isfinite(ranges) & (ranges > 0)
        if not known.all():
            ranges = np.where(known, ranges, np.float32(np.nan))
            for _ in range(2):                      # along rows, then along columns
                ranges = np.fmax(_carried(ranges), _carried(ranges[:, ::-1])[:, ::-1]).T
            ranges = np.nan_to_num(ranges, nan=FAR_M)
        return self._on(ranges if range_m is None else 1 / _smoothed(1 / ranges, self._steepest))

    def _move(self, sketch: Sketch, poses: list[Pose], group: Any, ranges: Any, moved: Moved) -> None:
        shape = tuple(sketch.photons.shape)
        require(shape == (self.sensor.rows, self.sensor.cols) and sketch.frequencies == self.frequencies, "sketch",
                f"{shape}, {sketch.frequencies}", f"{self.sensor.rows, self.sensor.cols}, {self.frequencies}")
        motions = np.stack([np.column_stack([pose.rotation, pose.translation]) for pose in poses]).astype(np.float32)
        photons = self._on(on_host(sketch.photons).astype(np.float32))
        self._kernels.move_sketch(self._on(sketch.sums), photons, self._used, self._rays, ranges,
                                  self._on(motions), group, self._lens, self._bin_frequencies, self._late,
                                  self.sensor.bin_width_m, self._steepest, *moved)

    def _on(self, values: Any) -> Any:
        return self._kernels.array(values) if isinstance(values, np.ndarray) else values


def pixels_of(sensor: SensorModel, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pixels that see points [N, 3] of the sensor's frame, and which of the points they are; int64 [M] each."""
    row, col = (np.floor(place + 0.5) for place in sensor.projection.places(xyz))
    seen = np.flatnonzero((row >= 0) & (row < sensor.rows) & (col >= 0) & (col < sensor.cols))      # not NaN
    return row[seen].astype(np.int64) * sensor.cols + col[seen].astype(np.int64), seen


def range_image(sensor: SensorModel, xyz: np.ndarray) -> np.ndarray:
    """Range of the nearest of the points that each pixel sees, metres, float32 [rows, cols]; NaN where it sees none.

    `xyz` [N, 3] are in the sensor's frame, such as a cloud after `Trajectory.motion`.
    """
    pixel, seen = pixels_of(sensor, xyz)
    xyz, nearest = xyz[seen].astype(np.float32), np.full((sensor.rows, sensor.cols), np.inf, np.float32)
    # one index and one dtype: fifty times faster
    np.minimum.at(nearest.reshape(-1), pixel, np.sqrt(np.einsum("nk,nk->n", xyz, xyz)))
    return np.where(np.isfinite(nearest), nearest, np.float32(np.nan))


def _smoothed(nearness: np.ndarray, steepest: float) -> np.ndarray:
    """1 / range, averaged along rows and columns over pairs of pixels to both sides that lie on the same surface.

    On a plane 1 / range is linear in a pinhole's pixels: slopes stay, and the last cloud's noise is not handed on.
    """
    for axis in (0, 1):
        nearness = np.moveaxis(nearness, axis, 0)
        total, count = nearness.copy(), np.ones_like(nearness)
        for k in range(1, min(SMOOTHED, (len(nearness) - 1) // 2) + 1):
            own, pair = nearness[k:-k], nearness[2 * k:] + nearness[:-2 * k]
            same = np.abs(pair - 2 * own) < steepest * own
            total[k:-k] += pair * same
            count[k:-k] += 2 * same
        nearness = np.moveaxis(total / count, 0, axis)
    return np.ascontiguousarray(nearness)


def _carried(values: np.ndarray) -> np.ndarray:
    """Each NaN is the last number before it in its row, if there is one."""
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(values.shape[1])), axis=1)
    return np.take_along_axis(values, last, axis=1)


def _in_groups(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times of groups of pixels, ns, int64 [G], and the group of each pixel, uint8 [rows, cols]."""
    first, last = float(times_s.min()), float(times_s.max())
    middles = np.linspace(first, last, MOST_GROUPS)
    group = np.rint((times_s - first) * ((MOST_GROUPS - 1) / max(last - first, 1e-12)))
    return np.rint(middles * 1e9).astype(np.int64), group.astype(np.uint8)
