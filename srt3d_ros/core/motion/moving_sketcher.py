"""MovingSketcher: sketches frames in parts, which a moving sensor sees from different places, and moves them to one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, reduce
from operator import add
from statistics import mean, median_low
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.motion.deskew import Deskewer, Parts
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums

PARTS = 10          # of a frame, at most: at 1 m/s and 100 ms, a part smears by 1 cm; moving it takes about 1 ms


class MovingFrame(NamedTuple):
    """A frame that has ended, not yet deskewed.

    Args:
        parts: instants, ns, and sketches, in order of time.
        first_ns, last_ns: the time that its trajectory must cover.
        stamp_ns: the instant to move to, the middle of its acquisition.
    """

    parts: Parts
    first_ns: int
    last_ns: int
    stamp_ns: int


class MovingSketcher:
    """Sketches the parts of a frame one by one; `finish` moves them to the middle of the frame and adds them up.

    A part has the packets of one stamp; in frames of more packets than `parts`, those of 1 / `parts` of the last
    frame's length. A packet lasts until the next one, so its photons count as in the middle.

    Args:
        sensor, frequencies, gate: as of `FrameSketcher`.
        parts: of a frame, at most; 1 for a sensor at rest.

    Attributes:
        lost: photons of the last finished frame that left the array.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int], gate: Gate | None = None, parts: int = PARTS):
        self._open = FrameSketcher(sensor, frequencies, gate=gate)         # of the open part
        self.gate, self.frequencies, self.sketch_sensor = gate, self._open.frequencies, self._open.sketch_sensor
        self.lost, self._most = 0, parts
        self._part_ns = 0                           # length of a part; 0: one part a stamp
        self.reset()

    def reset(self) -> None:
        """Forget all photons, and when they came."""
        self._open.reset()
        self._parts: list[tuple[list[int], PhaseSums]] = []        # packets' stamps and sketch
        self._previous_ns: int | None = None        # the last stamp of the frame before

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a packet that its `check` accepts."""
        if self._open.stamps_ns and len(self._parts) < self._most - 1 and self._ends_part(frame.stamp_ns):
            self._end_part()
        self._open.add(frame)

    def end_frame(self) -> MovingFrame:
        """End the open frame, which needs a packet."""
        self._end_part()
        stamps = sorted({stamp_ns for of_part, _ in self._parts for stamp_ns in of_part})
        packet_ns = self._packet_ns(stamps)
        length_ns = stamps[-1] + packet_ns - stamps[0]
        to_ns = stamps[0] + length_ns // 2
        parts = sorted(((round(mean(of_part)) + packet_ns // 2, sketch) for of_part, sketch in self._parts),
                       key=lambda part: part[0])
        instants = [to_ns, *(instant_ns for instant_ns, _ in parts)]
        self._part_ns = (length_ns + self._most - 1) // self._most if len(stamps) > self._most else 0
        self._parts, self._previous_ns = [], stamps[-1]
        return MovingFrame(parts, min(instants), max(instants), to_ns)

    def finish(self, frame: MovingFrame, trajectory: Trajectory | None) -> PhaseSums:
        """The sketch of a frame at `frame.stamp_ns`; without a trajectory, the sum of its parts as they are."""
        if trajectory is None:
            self.lost = 0
            return replace(reduce(add, (sketch for _, sketch in frame.parts)), stamp_ns=frame.stamp_ns)
        sketch = self._deskewer(frame.parts, trajectory, frame.stamp_ns)
        self.lost = self._deskewer.lost
        return sketch

    @cached_property
    def _deskewer(self) -> Deskewer:
        return Deskewer(self.sketch_sensor, self.frequencies)

    def _ends_part(self, stamp_ns: int) -> bool:
        """Whether a packet with this stamp begins another part."""
        part_ns, length_ns = self._open.stamps_ns[0], max(self._part_ns, 1)
        first_ns = self._parts[0][0][0] if self._parts else part_ns
        return (stamp_ns - first_ns) // length_ns != (part_ns - first_ns) // length_ns

    def _end_part(self) -> None:
        """Sketch the open part, which has a packet at least, and begin the next."""
        self._parts.append((self._open.stamps_ns, self._open.end_frame()))

    def _packet_ns(self, stamps: list[int]) -> int:
        """How long a packet lasts: the median step between stamps, from the last one of the frame before.

        Of two steps, the shorter: the other may be a pause between frames.
        """
        before = [] if self._previous_ns is None or self._previous_ns >= stamps[0] else [self._previous_ns]
        distances_ns = np.diff([*before, *stamps]).tolist()
        return median_low(distances_ns) if distances_ns else 0
