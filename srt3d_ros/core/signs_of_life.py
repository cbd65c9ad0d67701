"""SignsOfLife: which pixels of a stream are known to work; FreeSpaceStream: what is empty, of pixels that do.

A pixel without photons would claim the most. But it may be dead, the lens covered, or the laser off.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.free_space import NEAR, FreeSpace
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums

SIGNS = 12              # photons that show that a neighbourhood works
MEMORY_NS = 3_000_000_000       # in which they have to come
SLOT_NS = 100_000_000   # frames nearer in time than this are kept as one, to bound memory
EXPECTED = 24           # photons that tell a fall of the background to a quarter from chance
FALL = 0.25             # of the background: pixels that surely (2 σ) saw less may have died
HALF_LIFE_S = 10.0      # of the memory of how bright the background was
LOOKBACKS = 1, 3, 6, 11     # slots, and all; the dimmer, the more are needed to tell a fall
CLOUDS = 10             # whose median number of pixels with a point shows that the laser is on …
OVER_CHANCE = 5         # … if it is so many times that of the false points that are accepted
SIDES = NARROW, WIDE = 3, 5     # pixels, of squares: dead columns show in the narrow one, dim light in the wide one


class Slot(NamedTuple):
    """Sums over the frames of 0.1 s.

    Args:
        stamp_ns: of the first of them.
        sums: float32 [4, rows, cols]: photons; frames in which no point was near; photons around it in these, by SIDES.
    """

    stamp_ns: int
    sums: np.ndarray


class SignsOfLife:
    """Tells which pixels of a stream are known to work, from its frames of the last 3 s.

    It needs 12 photons in 3 × 3 pixels; 12 in 5 × 5 since the last point near it went; and a background, in 3 × 3 and
    5 × 5, of a quarter of what it was or more. All need more pixels with a point than false alarms explain: without
    these, the laser may be off.
    """

    def __init__(self):
        from scipy import ndimage  # here: slow, and few need it

        self._filters = ndimage
        self.forget()

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._slots: deque[Slot] = deque()
        self._points: deque[int] = deque(maxlen=CLOUDS)
        self._last_ns = 0

    def __call__(self, stamp_ns: int, photons: np.ndarray, has_point: np.ndarray, least_points: float) -> np.ndarray:
        """Which pixels are known to work after this frame, bool [rows, cols].

        Stamps that do not grow, or by more than 3 s, begin a new stream.

        Args:
            photons: [rows, cols], of the frame, 0 in masked pixels.
            has_point: bool [rows, cols].
            least_points: pixels with a point, which their median of ten frames has to exceed.
        """
        step_ns = stamp_ns - self._last_ns
        if not 0 < step_ns <= MEMORY_NS:
            self.forget()
        if not self._slots:
            step_ns, self._since, self._usual = 0, np.zeros(photons.shape, np.float32), np.zeros((2, 1, 1), np.float32)
            self._total = np.zeros((4, *photons.shape), np.float32)         # of all slots; whole numbers: no drift
        self._last_ns = stamp_ns
        quiet = ~self._near(has_point, 2 * NEAR + 1)
        self._add(stamp_ns, photons.astype(np.float32), quiet)
        self._points.append(int(has_point.sum()))
        signs, fell = self._fallen(0.5**(step_ns * 1e-9 / HALF_LIFE_S))
        dead = self._near(fell | quiet & (self._since < SIGNS), WIDE)
        dead |= self._near(self._box(signs, NARROW) < SIGNS, NARROW)
        return ~dead & (np.median(self._points) > least_points)

    def _add(self, stamp_ns: int, photons: np.ndarray, quiet: np.ndarray) -> None:
        """Take a frame into the newest slot, or a new one; end those that are older than 3 s."""
        around = [self._box(photons, side) * quiet for side in SIDES]
        self._since = (self._since + around[-1]) * quiet
        sums = np.stack([photons, quiet, *around], dtype=np.float32)
        while self._slots and stamp_ns - self._slots[-1].stamp_ns >= MEMORY_NS:
            self._total -= self._slots.pop().sums
        self._total += sums
        if self._slots and stamp_ns - self._slots[0].stamp_ns < SLOT_NS:
            begin_ns, before = self._slots.popleft()
            self._slots.appendleft(Slot(begin_ns, before + sums))
        else:
            self._slots.appendleft(Slot(stamp_ns, sums))

    def _fallen(self, fading: float) -> tuple[np.ndarray, np.ndarray]:
        """Photons of the last 3 s; and where the background around has fallen below a quarter of the usual."""
        part, fell = np.zeros_like(self._total[1:]), np.zeros(self._total.shape[1:], bool)
        self._usual *= fading
        for back, slot in zip(range(1, LOOKBACKS[-1] + 1), self._slots):
            part += slot.sums[1:]
            if back in LOOKBACKS:
                fell |= self._less(part)
        fell |= self._less(self._total[1:])
        now = np.where(self._total[2:] >= SIGNS, self._total[2:] / np.maximum(self._total[1], 1), 0)
        self._usual = np.maximum(now, self._usual)
        return self._total[0], fell

    def _less(self, part: np.ndarray) -> np.ndarray:
        """Where surely (2 σ) less than a quarter of the usual photons came in frames whose sums[1:] are `part`."""
        expected = part[0] * self._usual
        less = (expected >= EXPECTED) & (part[1:] + 2 * np.sqrt(part[1:]) < FALL * expected)
        return less[0] | less[1]

    def _near(self, where: np.ndarray, side: int) -> np.ndarray:
        """Where any pixel of a square around is true, bool."""
        return np.asarray(self._filters.maximum_filter(where, side), bool)

    def _box(self, values: np.ndarray, side: int) -> np.ndarray:
        """Sums of whole numbers over squares of pixels; 0 beyond the image."""
        return np.rint(self._filters.uniform_filter(values, side, mode="constant") * np.float32(side**2))


class FreeSpaceStream:
    """How far pixels that are known to work are empty, for successive frames of one sensor.

    Args:
        sensor, frequencies: of the sketches.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int]):
        self._free, self._life, self._used = FreeSpace(sensor, frequencies), SignsOfLife(), sensor.used
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
