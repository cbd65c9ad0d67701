"""MovingSketcher: frames of a sensor that moves, in parts that are each sketched alone, and moved to one instant."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np

from srt3d_ros.core.deskew import Deskewer, Parts
from srt3d_ros.core.gate import Gate
from srt3d_ros.core.motion import Trajectory
from srt3d_ros.core.moving_window import MovingWindow
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.core.window import MAX_WINDOW_BYTES
from srt3d_ros.errors import require

DESKEW_TO = ("start", "middle", "end")
DISTANCES = 16          # between stamps of packets, the last ones, whose median is the time that a packet takes


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """A frame that has ended, not yet deskewed.

    Args:
        parts: instants, ns, and sketches, in order of time.
        first_ns, last_ns: the time over which its trajectory has to be known.
        to_ns: the instant that it is moved to.
    """

    parts: Parts
    first_ns: int
    last_ns: int
    to_ns: int


class MovingSketcher(Sketcher):
    """Sketches the parts of a frame alone; `finish` moves them to the frame's own instant and adds them up.

    Packets belong to parts by their stamps, photons with times of their own by these. What a part costs is the memory
    of its sums, and the time to move it.

    Args:
        sensor, frequencies, gate: as for a Sketcher, on the CPU.
        window_frames: W, 1 or more: so many frames, each moved from its own instant to the newest one's, add up.
        subframes: the most parts of a frame; 1 or more.
        deskew_to: "start", "middle" or "end" of the frame's acquisition: the instant of its sketch, and its stamp.

    Attributes:
        lost: photons of the last frame that was finished which no pixel sees at its instant, or from masked pixels.

    Raises:
        InvalidInput: also if window and parts would take more than MAX_WINDOW_BYTES.
    """

    def __init__(self, sensor: SensorModel, frequencies, window_frames: int = 1, subframes: int = 10,
                 deskew_to: str = "middle", gate: Gate | None = None):
        super().__init__(sensor, frequencies, gate=gate)
        require(deskew_to in DESKEW_TO, "deskew_to", deskew_to, ", ".join(DESKEW_TO))
        require(subframes >= 1, "subframes", subframes, "1 or more")
        self.subframes, self._deskew_to = subframes, deskew_to
        self._deskewer = Deskewer(gate.sensor if gate else sensor, self.frequencies)
        self._window = MovingWindow(self._deskewer)
        self._times_s = getattr(sensor, "pixel_times_s", None)      # a pixel's photons come at its own time
        self._spare = [(self._sums, self._photons)]
        self._slot_ns, self._previous_ns, self._distances = 0, None, []
        self.lost = 0
        self._begin()
        self.resize(window_frames)

    def resize(self, window_frames: int) -> None:
        """Change W; a longer window grows frame by frame. Raises InvalidInput as above."""
        sums, photons = self._spare[0] if self._spare else next(iter(self._parts.values()))
        each = self.sensor.pixels * (8 * len(self.frequencies) + 4)
        most = max((MAX_WINDOW_BYTES - self.subframes * (sums.nbytes + photons.nbytes + each)) // each, 1)
        require(1 <= window_frames <= most, "window_frames", window_frames, f"1 to {most} for {self.sensor.rows} × "
                f"{self.sensor.cols} pixels and {self.subframes} subframes")
        self.window_frames = self._window.frames = window_frames

    def reset(self) -> None:
        """Forget all photons, of the open frame and of all before."""
        self._discard()
        self._window.reset()
        self._previous_ns = None

    @property
    def kept(self) -> int:
        """Photons of the open frame that are inside the gate, which there has to be."""
        return sum(int(self._kernels.counted(sums, 2 * len(self.frequencies)).sum()) for sums, _ in
                   self._parts.values())

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a packet; InvalidInput, and none is added, if one is outside the sensor."""
        for slot, instant_ns, weight, photons in self._split(frame):
            self._sums, self._photons = self._part(slot)
            super().add(photons)
            self._instants[slot].append((instant_ns, weight))
        self._stamps.add(frame.stamp_ns)

    def end_frame(self) -> MovingFrame:
        """End the open frame."""
        stamps = sorted(self._stamps) or [0]
        length_ns = self._packet_ns(stamps)
        end_ns = max(self._end_ns, stamps[-1] + length_ns)
        if self._times_s is not None:
            end_ns = max(end_ns, stamps[0] + round(float(self._times_s.max()) * 1e9))
        to_ns = {"start": stamps[0], "middle": (stamps[0] + end_ns) // 2, "end": end_ns}[self._deskew_to]
        parts = []
        for slot, (self._sums, self._photons) in self._parts.items():
            instants, weights = zip(*self._instants[slot])
            middle = round(np.average(np.subtract(instants, stamps[0]), weights=np.maximum(weights, 1)))
            own = self._end_ns > stamps[-1] or self._times_s is not None
            parts.append((stamps[0] + middle + (0 if own else length_ns // 2), self.sketch()))
        parts.sort(key=lambda part: part[0])
        instants = [instant for instant, _ in parts] + [to_ns, *([stamps[0], end_ns] if self._times_s is not None else [])]
        crowded = len(stamps) > self.subframes or self._end_ns > stamps[-1]
        self._slot_ns = -(-(end_ns - stamps[0]) // self.subframes) if crowded else 0
        self._previous_ns = stamps[-1]
        self._discard()
        return MovingFrame(parts, min(instants), max(instants), to_ns)

    def finish(self, frame: MovingFrame, trajectory: Trajectory | None, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of a frame, or of the window of which it is the last, at `frame.to_ns`, by the sensor's motion.

        Without a trajectory its parts add up as they are, and the window begins anew.

        Args:
            range_m: as of `Deskewer`.

        Raises:
            InvalidInput: the trajectory does not cover the frame.
        """
        if trajectory is None or not frame.parts:
            self._window.reset()
            self.lost = 0
            empty = Sketch(self.frequencies, *self._empty(), frame.to_ns)
            return replace(reduce(add, (sketch for _, sketch in frame.parts), empty), stamp_ns=frame.to_ns)
        sketch = self._deskewer(frame.parts, trajectory, frame.to_ns, range_m)
        self.lost = self._deskewer.lost
        return self._window.add(sketch, trajectory, range_m)

    def _split(self, frame: PhotonFrame) -> Iterator[tuple[int, int, int, PhotonFrame]]:
        """The parts that a packet's photons belong to: slot, instant (ns), weight of the instant, photons."""
        times = getattr(frame, "t", None) if isinstance(frame, PhotonEvents) else None
        if self._times_s is not None:
            yield 0, min(self._stamps | {frame.stamp_ns}), 1, frame
            return
        if times is None or not len(times):
            yield self._slot(frame.stamp_ns), frame.stamp_ns, 1, frame
            return
        late_ns = np.rint(times * (np.float64(1e9) if times.dtype.kind == "f" else 1)).astype(np.int64)
        self._end_ns = max(self._end_ns, frame.stamp_ns + int(late_ns.max()) + 1)
        self._slot_ns = self._slot_ns or -(-int(late_ns.max() + 1) // self.subframes)
        self._first_ns = frame.stamp_ns if self._first_ns is None else self._first_ns
        slots = (late_ns + (frame.stamp_ns - self._first_ns)) // self._slot_ns
        for slot in np.unique(slots):
            chosen = np.flatnonzero(slots == slot)
            yield (self._nearest(int(slot)), frame.stamp_ns + round(float(late_ns[chosen].mean())), len(chosen),
                   PhotonEvents(frame.pixel[chosen], frame.toa[chosen], frame.stamp_ns))

    def _slot(self, stamp_ns: int) -> int:
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        late_ns = stamp_ns - self._first_ns
        return self._nearest(late_ns // self._slot_ns if self._slot_ns else late_ns)

    def _nearest(self, slot: int) -> int:
        if slot in self._parts or len(self._parts) < self.subframes:
            return slot
        return min(self._parts, key=lambda other: abs(other - slot))

    def _part(self, slot: int):
        if slot not in self._parts:
            self._parts[slot] = self._spare.pop() if self._spare else \
                self._kernels.new_sums(self.sensor.pixels, 2 * len(self.frequencies) + (2 if self.gate else 0))
        return self._parts[slot]

    def _packet_ns(self, stamps: list[int]) -> int:
        """The time that a packet takes: the median of the last distances between stamps; of one frame before, if any."""
        before = [self._previous_ns] if self._previous_ns is not None and self._previous_ns < stamps[0] else []
        self._distances = [*self._distances, *np.diff([*before, *stamps]).tolist()][-DISTANCES:]
        return int(np.median(self._distances)) if self._distances else 0

    def _empty(self):
        shape = self.sensor.rows, self.sensor.cols
        return np.zeros((*shape, len(self.frequencies)), np.complex64), np.zeros(shape, np.uint32)

    def _discard(self) -> None:
        for sums, photons in self._parts.values():
            sums[:] = 0
            photons[:] = 0
            self._spare.append((sums, photons))
        self._begin()

    def _begin(self) -> None:
        self._parts, self._instants, self._stamps = {}, defaultdict(list), set()
        self._first_ns, self._end_ns, self._stamp_ns = None, 0, None
