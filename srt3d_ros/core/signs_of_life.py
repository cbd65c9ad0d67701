"""SignsOfLife: which pixels of a stream are known to work; FreeSpaceStream: what is empty, of pixels that do.

A pixel without photons would claim the most. But it may be dead, the lens covered, or the laser off.
"""

import math
from collections import deque
from collections.abc import Sequence
from statistics import median

import numpy as np

from srt3d_ros.core.free_space import NEAR, FreeSpace, of_square
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels.constants import EPSILON

SIGNS = 12              # photons that show that a neighbourhood works
MEMORY_S = 3.0          # mean age of the photons that count; a longer pause begins a new stream
HALF_LIFE_S = 10.0      # of the memory of how bright the background was
DIM, DEAD = 0.5, 0.1    # shares of the usual background: light that has halved is told from pixels that died …
SURE = 7.0              # … with this log-likelihood ratio: e⁻⁷ = 0.1 % of the halved would be taken for dead
CLOUDS = 10             # whose median number of pixels with a point shows that the laser is on …
OVER_CHANCE = 5         # … if it is so many times that of the false points that are accepted
REACHES = NARROW, WIDE = 1, 2   # pixels: dead columns show in squares of 3 × 3 pixels, dim light in those of 5 × 5


class SignsOfLife:
    """Tells which pixels of a stream are known to work, from its frames of about the last 3 s.

    It needs 12 photons in 3 × 3 pixels; 12 in 5 × 5 since the last point near it went; and a background, in 3 × 3 and
    5 × 5 pixels, its row and its column, that has not fallen to a tenth. All need more pixels with a point than false
    alarms explain: without these, the laser may be off.

    Args:
        exposure: relative efficiency of the pixels, 0 where masked, [rows, cols].
    """

    def __init__(self, exposure: np.ndarray):
        exposure = exposure.astype(np.float32)
        self._share = exposure / np.maximum(of_square(np.add, exposure, WIDE), EPSILON)     # of the wide square's light
        self.forget()

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        rows, cols = self._share.shape
        self._points: deque[int] = deque(maxlen=CLOUDS)
        self._last_ns, self._since = 0, np.zeros((rows, cols), np.float32)
        self._sums, self._usual = np.zeros((4, rows, cols), np.float32), np.zeros((2, rows, cols), np.float32)
        self._evidence = [np.zeros(shape, np.float32) for shape in ((2, rows, cols), (rows, 1), (cols,))]

    def __call__(self, stamp_ns: int, photons: np.ndarray, has_point: np.ndarray, least_points: float) -> np.ndarray:
        """Which pixels are known to work after this frame, bool [rows, cols].

        Stamps that do not grow, or by more than 3 s, begin a new stream.

        Args:
            photons: [rows, cols], of the frame, 0 in masked pixels.
            has_point: bool [rows, cols].
            least_points: pixels with a point, which their median of ten frames has to exceed.
        """
        step_s = (stamp_ns - self._last_ns) * 1e-9
        if not 0 < step_s <= MEMORY_S:
            self.forget()
            step_s = 0.0        # by a clock that was set back, memory would grow beyond all numbers
        self._last_ns = stamp_ns
        self._points.append(int(np.count_nonzero(has_point)))
        photons, quiet = photons.astype(np.float32), ~of_square(np.logical_or, has_point, NEAR)
        around = np.stack([of_square(np.add, photons, reach) for reach in REACHES])
        dark = around * quiet
        fallen = self._fallen(photons, dark, quiet)
        self._since = (self._since + around[1]) * quiet
        self._sums *= np.float32(math.exp(-step_s / MEMORY_S))
        recent, frames, light = self._sums[0], self._sums[1], self._sums[2:]
        recent += around[0]
        frames += quiet
        light += dark
        now = light / np.maximum(frames, EPSILON) * (light >= SIGNS)
        self._usual = np.maximum(self._usual * np.float32(0.5**(step_s / HALF_LIFE_S)), now)
        dead = _near(fallen | quiet & (self._since < SIGNS), WIDE) | _near(recent < SIGNS, NARROW)
        return ~dead & (median(self._points) > least_points)

    def _fallen(self, photons: np.ndarray, dark: np.ndarray, quiet: np.ndarray) -> np.ndarray:
        """Where the background has fallen, by E. S. Page's sequential test (Biometrika 41, 1954); bool [rows, cols].

        Args:
            dark: photons around quiet pixels, by REACHES.
            quiet: pixels without a point near.
        """
        usual = self._usual * quiet
        own = _evidence(usual[1] * self._share, photons * quiet)
        added = _evidence(usual, dark), own.sum(axis=1, keepdims=True), own.sum(axis=0)
        self._evidence = [np.minimum(np.maximum(before + more, 0), np.float32(2 * SURE))
                          for before, more in zip(self._evidence, added)]
        squares, rows, cols = (each > SURE for each in self._evidence)
        return squares.any(axis=0) | rows | cols


def _near(where: np.ndarray, reach: int) -> np.ndarray:
    """Where any pixel of a square around is true, bool."""
    return of_square(np.logical_or, where, reach) if where.any() else where


def _evidence(usual: np.ndarray, photons: np.ndarray) -> np.ndarray:
    """Logarithm of how much likelier so many photons are of a background that died than of one that halved."""
    return np.float32(DIM - DEAD) * usual - np.float32(math.log(DIM / DEAD)) * photons


class FreeSpaceStream:
    """How far pixels that are known to work are empty, for successive frames of one sensor.

    Args:
        sensor, frequencies: of the sketches.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int]):
        self._free, self._life, self._used = FreeSpace(sensor, frequencies), SignsOfLife(sensor.exposure), sensor.used
        self.end_m = self._free.end_m

    def __call__(self, sketch: PhaseSums, cloud: PointCloud, brightness: float, max_range_m: float = 0.0,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE) -> np.ndarray:
        """As `FreeSpace.range_m`, and NaN where no sign of life says that a pixel without photons is a dark one.

        Args:
            sketch, cloud, brightness, max_range_m: as of `FreeSpace.range_m`; `sketch.stamp_ns` has to grow.
            false_alarm_rate: that of the cloud.
        """
        free = self._free.range_m(sketch, cloud, brightness, max_range_m)
        has_point = np.zeros(free.shape, bool)
        has_point[cloud.row, cloud.col] = True
        false_points = false_alarm_rate * np.count_nonzero(self._used)
        works = self._life(sketch.stamp_ns, sketch.photons * self._used, has_point, OVER_CHANCE * false_points)
        return np.where(works, free, np.float32(np.nan))
