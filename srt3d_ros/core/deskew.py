"""Deskewer: sketches of a sensor that moved, moved to where they would be seen from at one instant, and added up.

A surface at range ρ along a pixel's ray d, seen at some instant, lies at X = ρ R d + p in the sensor's frame at another
one. There the pixels that look at X see it, and |X| − ρ farther away, which is exactly a factor exp(i ω_l Δ) of the
sums for Δ bins. The photons go to where X is, instead of each pixel's asking where its photons were: so none is lost
but those that leave the array, none counts twice, and a surface behind another does not shine through. The four pixels
around share them (to give all to the nearest costs 20 % of depth error on slopes), each as if the surface had been seen
at its own place: along the surface of the last cloud, not across its edges.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require

MOST_GROUPS = 64        # of pixels that look at about the same time: at 30°/s and 100 ms, 0.05° apart
FAR_M = 1e3             # what is at no known range: its parallax is less than a pixel
STEEPEST = 6.0          # tangent of the incidence, 80°, beyond which neighbouring pixels see two surfaces
Parts = Sequence[tuple[int, Sketch]]


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
        lost: photons of the last call that no pixel sees any more, or that came from masked ones.
    """

    def __init__(self, sensor: SensorModel, frequencies, device: str = "cpu"):
        self.sensor, self.lost = sensor, 0
        self.frequencies = check_frequencies(frequencies, sensor.num_bins)
        _, self._kernels = kernels_for(device)
        on, shape = self._kernels.array, (sensor.rows, sensor.cols)
        self._rays, self._lens = on(sensor.rays), on(sensor.projection.lens)
        self._late = on(np.zeros(shape, np.float32) if sensor.delay_bins is None else sensor.delay_bins)
        self._used = on(np.ones(shape, np.float32) if sensor.mask is None else sensor.mask.astype(np.float32))
        self._bin_frequencies = on((np.array(self.frequencies) / sensor.num_bins).astype(np.float32))
        apart = np.linalg.norm(np.diff(sensor.rays, axis=1), axis=-1)
        self._steepest = STEEPEST * float(np.median(apart)) if apart.size else 0.0
        self._together, self._all = np.zeros(1, np.int64), on(np.zeros(shape, np.uint8))
        self._group = self._all
        if (times := getattr(sensor, "pixel_times_s", None)) is not None:
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
        moving = [([trajectory.motion(int(instant_ns + late_ns), to_ns) for late_ns in self._together], sketch)
                  for instant_ns, sketch in parts]
        return self._add(moving, self._group, range_m, to_ns)

    def move(self, sketch: Sketch, motion: Pose, to_ns: int, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of photons of one instant, of all pixels, after this motion."""
        return self._add([([motion], sketch)], self._all, range_m, to_ns)

    def _add(self, moving: list[tuple[list[Pose], Sketch]], group: np.ndarray, range_m: np.ndarray | None,
             to_ns: int) -> Sketch:
        kernels, on = self._kernels, self._on_device
        width, shape = self.sensor.bin_width_m, (self.sensor.rows, self.sensor.cols)
        ranges, came = on(filled(range_m, shape)), 0
        moved, numbers = on(np.zeros((*shape, len(self.frequencies)), np.complex64)), on(np.zeros(shape, np.float32))
        for poses, sketch in moving:
            require(tuple(sketch.photons.shape) == shape and sketch.frequencies == self.frequencies, "sketch",
                    f"{tuple(sketch.photons.shape)}, {sketch.frequencies}", f"{shape}, {self.frequencies}")
            motions = np.stack([np.column_stack([pose.rotation, pose.translation]) for pose in poses])
            photons = on(sketch.photons)
            kernels.move_sketch(on(sketch.sums), photons, self._used, self._rays, ranges,
                                on(motions.astype(np.float32)), group, self._lens, self._bin_frequencies, self._late,
                                width, self._steepest, moved, numbers)
            came += int(kernels.numpy(photons).sum(dtype=np.int64))
        self.lost = came - round(float(kernels.numpy(numbers).sum(dtype=np.float64)))
        sums, photons = kernels.read_moved(moved, numbers, ranges, self._late, self._bin_frequencies, width)
        return Sketch(self.frequencies, sums, photons, to_ns,
                      max((sketch.added_variance for _, sketch in moving), default=0.0))

    def _on_device(self, values: Any) -> Any:
        return self._kernels.array(values) if isinstance(values, np.ndarray) else values


def filled(range_m: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """Ranges of all pixels, float32 [rows, cols]: where unknown that of the farther neighbour, FAR_M if none is known.

    The neighbours are the next in the row that are known, or in the column where a row knows nothing: what a motion
    uncovers is more often part of what is behind.
    """
    if range_m is None:
        return np.full(shape, FAR_M, np.float32)
    require(np.shape(range_m) == shape, "range_m shape", np.shape(range_m), f"[rows, cols] = {shape}")
    ranges = np.where(np.isfinite(range_m) & (range_m > 0), range_m, np.nan)
    for _ in range(2):                          # along rows, then along columns
        ranges = np.fmax(_carried(ranges), _carried(ranges[:, ::-1])[:, ::-1]).T
    return np.ascontiguousarray(np.nan_to_num(ranges, nan=FAR_M), np.float32)


def range_image(sensor: SensorModel, xyz: np.ndarray) -> np.ndarray:
    """Range of the nearest of the points that each pixel sees, metres, float32 [rows, cols]; NaN where it sees none.

    `xyz` [N, 3] are in the sensor's frame, such as a cloud after `Trajectory.motion`.
    """
    row, col = (np.floor(place + 0.5) for place in sensor.projection.places(xyz))
    seen = np.flatnonzero((row >= 0) & (row < sensor.rows) & (col >= 0) & (col < sensor.cols))      # not NaN
    ranges, nearest = np.linalg.norm(xyz[seen], axis=1), np.full((sensor.rows, sensor.cols), np.inf, np.float32)
    np.minimum.at(nearest, (row[seen].astype(int), col[seen].astype(int)), ranges)
    return np.where(np.isfinite(nearest), nearest, np.float32(np.nan))


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
