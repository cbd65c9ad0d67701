"""MovingSketcher: frames of a sensor that moves, in parts that are each sketched alone, and moved to one instant."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from statistics import median_low
from typing import Any

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


@dataclass(frozen=True, eq=False)
class _OpenPart:
    """The photons of a part so far, and their instants, ns, each with its weight."""

    sums: Any
    photons: Any
    instants: list[tuple[int, int]] = field(default_factory=list)


class MovingSketcher(Sketcher):
    """Sketches the parts of a frame alone; `finish` moves them to the frame's own instant and adds them up.

    Packets belong to parts by their stamps, photons with a time `t` of their own by this. Where packets are more than
    `subframes`, parts are as long as the frame before says. A packet lasts until the next one: its photons come in the
    middle. Those of a sensor with `pixel_times_s` come at their pixels' times after the frame's first stamp.

    Args:
        sensor, frequencies, gate: as for a Sketcher, on the CPU.
        window_frames: W, 1 or more: so many frames, each moved from its own instant to the newest one's, add up.
        subframes: the most parts of a frame, 1 or more. Each takes the memory of sums, and the time to move it.
        deskew_to: "start", "middle" or "end" of the frame's acquisition: the instant of its sketch, and its stamp.

    Attributes:
        lost: photons of the last frame finished that no pixel sees at its instant.

    Raises:
        InvalidInput: also if window and parts would take more than MAX_WINDOW_BYTES.
    """

    def __init__(self, sensor: SensorModel, frequencies, window_frames: int = 1, subframes: int = 10,
                 deskew_to: str = "middle", gate: Gate | None = None):
        super().__init__(sensor, frequencies, gate=gate)
        require(deskew_to in DESKEW_TO, "deskew_to", deskew_to, ", ".join(DESKEW_TO))
        require(subframes >= 1, "subframes", subframes, "1 or more")
        self.subframes, self._deskew_to, self.lost = subframes, deskew_to, 0
        self._deskewer = Deskewer(self.sketch_sensor, self.frequencies)
        self._window = MovingWindow(self._deskewer)
        self._times_s = sensor.pixel_times_s
        self._spare = [(self._sums, self._photons)]
        self._frame_bytes = sensor.pixels * (8 * len(self.frequencies) + 4)
        self._part_bytes = self._sums.nbytes + self._photons.nbytes + self._frame_bytes     # while open, and sketched
        self._slot_ns = 0                           # the length of a part; 0: each stamp has its own
        self._previous_ns: int | None = None        # the last stamp of the frame before
        self._distances_ns: list[int] = []
        self._begin()
        most = max((MAX_WINDOW_BYTES - self._frame_bytes) // self._part_bytes, 1)
        require(subframes <= most, "subframes", subframes, f"1 to {most}: each takes {self._part_bytes / 1e6:.3g} MB")
        self.resize(window_frames)

    def resize(self, window_frames: int) -> None:
        """Change W; a longer window grows frame by frame. Raises InvalidInput as above."""
        most = max((MAX_WINDOW_BYTES - self.subframes * self._part_bytes) // self._frame_bytes, 1)
        require(1 <= window_frames <= most, "window_frames", window_frames, f"1 to {most} for {self.sensor.rows} × "
                f"{self.sensor.cols} pixels in {self.subframes} subframes, which take "
                f"{self._frame_bytes / 1e6:.3g} MB a frame")
        self.window_frames = self._window.frames = window_frames

    def reset(self) -> None:
        """Forget all photons, of the open frame and of all before."""
        self._discard()
        self._window.reset()
        self._previous_ns = None

    @property
    def kept(self) -> int:
        """Photons of the open frame that are inside the gate, which there has to be."""
        column = 2 * len(self.frequencies)
        return sum(int(self._kernels.counted(part.sums, column).sum()) for part in self._parts.values())

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a packet; InvalidInput, and none is added, if one is outside the sensor."""
        first_ns = frame.stamp_ns if self._first_ns is None else self._first_ns
        told = self._times_s is None and isinstance(frame, PhotonEvents) and frame.t is not None
        if told and frame.photons:
            frame.check(self.sensor)
            pieces = self._by_time(frame, first_ns)
        else:
            pieces = ((frame.stamp_ns, 1, frame),)
        for instant_ns, weight, photons in pieces:
            part = self._part(0 if self._times_s is not None else instant_ns - first_ns)
            self._sums, self._photons = part.sums, part.photons
            super().add(photons)
            part.instants.append((instant_ns, weight))
        self._first_ns = first_ns
        self._stamps.add(frame.stamp_ns)

    def end_frame(self) -> MovingFrame:
        """End the open frame."""
        stamps = sorted(self._stamps) or [0]
        packet_ns, first_ns, late_ns = self._packet_ns(stamps), stamps[0], 0
        if self._times_s is not None:
            end_ns = first_ns + round(float(self._times_s.max()) * 1e9)
        elif self._told_ns is not None:
            end_ns = max(self._told_ns, stamps[-1])
        else:
            end_ns, late_ns = stamps[-1] + packet_ns, packet_ns // 2
        parts = []
        for part in self._parts.values():
            if part.instants:
                self._sums, self._photons = part.sums, part.photons
                after_ns, weights = np.subtract(part.instants, (first_ns, 0)).T
                middle_ns = 0 if self._times_s is not None else round(np.average(after_ns, weights=weights)) + late_ns
                parts.append((first_ns + middle_ns, self.sketch()))
        parts.sort(key=lambda part: part[0])
        to_ns = {"start": first_ns, "middle": (first_ns + end_ns) // 2, "end": end_ns}[self._deskew_to]
        instants = [to_ns, *(instant for instant, _ in parts), *([] if self._times_s is None else [first_ns, end_ns])]
        crowded = self._told_ns is not None or len(stamps) > self.subframes
        self._slot_ns = -(-(end_ns - first_ns) // self.subframes) if crowded else 0
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
            shape = self.sensor.rows, self.sensor.cols
            empty = Sketch(self.frequencies, np.zeros((*shape, len(self.frequencies)), np.complex64),
                           np.zeros(shape, np.uint32))
            return replace(reduce(add, (sketch for _, sketch in frame.parts), empty), stamp_ns=frame.to_ns)
        ranges = self._deskewer.filled(range_m)
        sketch = self._deskewer.add_up(frame.parts, trajectory, frame.to_ns, ranges)
        self.lost = self._deskewer.lost
        return self._deskewer.rounded(self._window.add(sketch, trajectory, ranges))

    def _by_time(self, events: PhotonEvents, first_ns: int) -> Iterator[tuple[int, int, PhotonEvents]]:
        """The photons of each part: their mean instant, ns, their number, and they themselves."""
        after_ns = events.t.astype(np.int64) + (events.stamp_ns - first_ns)
        last_ns = int(after_ns.max())
        self._told_ns = max(self._told_ns or 0, first_ns + last_ns)
        self._slot_ns = self._slot_ns or max(-(-(last_ns + 1) // self.subframes), 1)
        slots = after_ns // self._slot_ns
        for slot in np.unique(slots):
            chosen = np.flatnonzero(slots == slot)
            yield first_ns + round(float(after_ns[chosen].mean())), len(chosen), events.part(chosen)

    def _part(self, after_ns: int) -> _OpenPart:
        """The part of photons so long after the frame's first packet; the nearest if there are enough parts already."""
        slot = after_ns // self._slot_ns if self._slot_ns else after_ns
        if slot not in self._parts and len(self._parts) >= self.subframes:
            slot = min(self._parts, key=lambda other: abs(other - slot))
        if slot not in self._parts:
            values = 2 * len(self.frequencies) + (0 if self.gate is None else 2)
            sums = self._spare.pop() if self._spare else self._kernels.new_sums(self.sensor.pixels, values)
            self._parts[slot] = _OpenPart(*sums)
        return self._parts[slot]

    def _packet_ns(self, stamps: list[int]) -> int:
        """The time that a packet takes: the median of the last distances between stamps, also those of frames.

        Of two, the shorter: a pause between frames is no packet's.
        """
        before = [] if self._previous_ns is None or self._previous_ns >= stamps[0] else [self._previous_ns]
        self._distances_ns = [*self._distances_ns, *np.diff([*before, *stamps]).tolist()][-DISTANCES:]
        return median_low(self._distances_ns) if self._distances_ns else 0

    def _discard(self) -> None:
        """Begin a frame without photons; the memory of the parts' sums is used again."""
        for part in self._parts.values():
            part.sums[:] = 0
            part.photons[:] = 0
            self._spare.append((part.sums, part.photons))
        self._begin()

    def _begin(self) -> None:
        self._parts: dict[int, _OpenPart] = {}
        self._stamps: set[int] = set()
        self._first_ns, self._told_ns, self._stamp_ns = None, None, None
