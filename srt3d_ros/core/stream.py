"""SketchStream: packets of photons in, sketches of frames out, for nodes, library, bags and evaluation."""

import threading
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.motion.moving_sketcher import PARTS, MovingFrame, MovingSketcher
from srt3d_ros.core.motion.track import MotionReport, SensorMotion
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import SketchDesign, design_sketch
from srt3d_ros.core.sketching.framing import Framing, OpenFrame
from srt3d_ros.core.sketching.gate import OFF, in_ranges
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums

MOTION_S = 1.0          # longest wait for motion: odometry comes 10 to 100 ms late; after a second it has stopped
MOST_FRAMES, MOST_BYTES = 4, 2**28      # frames that may wait for motion; more while all take less memory than this


class Counts:
    """How many packets and photons came, were published, and were dropped, since the start; for any thread."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self.totals: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()              # packets or frames, by cause
        self.photons_dropped: Counter[str] = Counter()

    def count(self, **amounts: int) -> None:
        """Add to totals of these names."""
        with self._lock:
            self.totals.update(amounts)

    def drop(self, cause: str, frames: int = 1, photons: int = 0) -> None:
        """Count frames that were dropped for `cause`, and their photons."""
        with self._lock:
            self.dropped[cause] += frames
            self.photons_dropped[cause] += photons


@dataclass(frozen=True)
class StreamOptions:
    """How packets become frames, and frames sketches.

    Args:
        gate, frequencies, sketch_size: see `design_sketch`.
        packets_per_frame, frame_period_ns: as of Framing.
        moving: deskew each frame to the sensor's pose in its middle, with the reports given to `add_motion`.
    """

    gate: str = OFF
    frequencies: str = "auto"
    sketch_size: int | None = None
    packets_per_frame: int = 1
    frame_period_ns: int = 0
    moving: bool = False

    def check(self, sensor: SensorModel) -> SketchDesign:
        """The design for a sensor; InvalidInput if the options do not suit it."""
        return design_sketch(sensor, self.gate, self.frequencies, self.sketch_size)


class SketchStream:
    """Sketches the frames of one sensor. Calls never block; one thread at a time.

    Every packet and photon is in a returned sketch, in an open or waiting frame, or counted as dropped for a cause.

    Args:
        sensor: of the photons that come in; its `extrinsics` are where it sits on the body that is reported on.
        counts: receives totals `photons_in`, `packets` and `photons` (of returned sketches), and drops by cause.

    Attributes:
        packets_per_frame: of the last frame that ended.
        warning: why frames were not deskewed; callers reset it to "".

    Raises:
        InvalidInput: options that contradict each other or do not suit the sensor.
    """

    def __init__(self, sensor: SensorModel, options: StreamOptions = StreamOptions(), counts: Counts | None = None):
        self.sensor, self.options, self.counts = sensor, options, Counts() if counts is None else counts
        self.warning = ""
        self._framing = Framing(options.packets_per_frame, options.frame_period_ns)
        gate, frequencies = options.check(sensor)
        self._sketcher = MovingSketcher(sensor, frequencies, gate, PARTS if options.moving else 1)
        self._motion = SensorMotion(Pose.from_text(sensor.extrinsics or ""))
        self._waiting: deque[tuple[MovingFrame, OpenFrame, float]] = deque()       # and when they ended
        self._came_s = -float("inf")
        self.packets_per_frame = options.packets_per_frame

    # ---- Input

    def push(self, packet: PhotonFrame, now_s: float = 0.0) -> list[PhaseSums]:
        """Add a packet; returns the sketches that are finished.

        Args:
            now_s: the time, of the same clock as for `poll`.

        Raises:
            InvalidInput: photons outside the sensor. The packet changes nothing.
        """
        packet.check(self.sensor)       # first: a bad packet's stamp must not end a frame
        self.counts.count(photons_in=packet.photons)
        self._came_s = now_s
        closed, began_again, late = self._framing.place(packet.stamp_ns)
        is_dropped = began_again and not self._framing.period_ns
        sketches = [] if is_dropped else self._end_frame(closed, now_s)
        if began_again:
            self.counts.count(stamp_leaps=1)
            self._forget(closed if is_dropped else None)
        if late:
            self.counts.drop("late", photons=packet.photons)
        else:
            self._sketcher.add(packet)
            sketches += self._end_frame(self._framing.add(packet.stamp_ns, packet.photons), now_s)
        return sketches + self.poll(now_s)

    def add_motion(self, report: MotionReport) -> str:
        """Add a report of motion; see `SensorMotion.add`."""
        return self._motion.add(report)

    # ---- Output

    def poll(self, now_s: float = 0.0) -> list[PhaseSums]:
        """The sketches finished by now: of frames that end by silence, and of those that need not wait longer."""
        silent = self.options.frame_period_ns and now_s - self._came_s > self._framing.silence_ns * 1e-9
        sketches = self._end_frame(self._framing.flush(), now_s) if silent else []
        return sketches + self._deskewed(now_s)

    @property
    def waits_for_motion(self) -> bool:
        """Whether ended frames wait for reports of motion."""
        return bool(self._waiting)

    def reset(self) -> list[PhaseSums]:
        """Drop the open frame as `incomplete` and begin a new window; returns the sketches of ended frames."""
        sketches = self._deskewed(at_once=True)
        self._forget(self._framing.clear())
        return sketches

    def flush(self) -> list[PhaseSums]:
        """End the open frame, unless it waits for its number of packets; returns all sketches."""
        return self._end_frame(self._framing.flush(), self._came_s) + self.reset()

    # ---- State

    @property
    def frame(self) -> OpenFrame:
        """Packets and photons of the open frame."""
        return self._framing.open

    @property
    def sketch_sensor(self) -> SensorModel:
        """The sensor of the next sketches: that of the photons, or what the gate keeps of it."""
        return self._sketcher.sketch_sensor

    @property
    def facts(self) -> dict[str, object]:
        """Size, gate and frequencies of the next sketches, for people to read."""
        sensor = self.sketch_sensor
        return {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                "gate": in_ranges(self._sketcher.gate),
                "frequencies": " ".join(map(str, self._sketcher.frequencies))}

    # ---- Frames

    def _forget(self, frame: OpenFrame | None) -> None:
        """Begin a new window; counts the open frame, if any, as dropped."""
        if frame is not None:
            self.counts.drop("incomplete", *frame)
        self._sketcher.reset()

    def _end_frame(self, content: OpenFrame | None, now_s: float) -> list[PhaseSums]:
        """The sketch of a frame that ended, if any; that of a moving sensor waits for reports."""
        if content is None:
            return []
        self.packets_per_frame, kept, frame = content.packets, content.photons, self._sketcher.end_frame()
        sketches = [sketch for _, sketch in frame.parts]
        if self._sketcher.gate is not None:
            kept = min(sum(int(sketch.photons.sum(dtype=np.int64)) for sketch in sketches), kept)
        self.counts.drop("gate", frames=0, photons=content.photons - kept)
        content = content._replace(photons=kept)
        if self.options.moving:
            self._waiting.append((frame, content, now_s))
            return []
        self.counts.count(**content._asdict())
        return sketches

    def _deskewed(self, now_s: float = 0.0, at_once: bool = False) -> list[PhaseSums]:
        """The sketches of the frames that need not wait longer for reports of motion, in order."""
        sketches = []
        while self._waiting:
            frame, content, since_s = self._waiting[0]
            nbytes = sum(sketch.sums.nbytes for waiting, *_ in self._waiting for _, sketch in waiting.parts)
            exceeds_memory = len(self._waiting) > MOST_FRAMES and nbytes > MOST_BYTES
            late = at_once or exceeds_memory or not 0 <= now_s - since_s < MOTION_S
            trajectory, cause = self._motion.over(frame.first_ns, frame.last_ns, late)
            if trajectory is None and not cause:
                break
            self._waiting.popleft()
            sketches.append(self._sketcher.finish(frame, trajectory))
            lost = min(self._sketcher.lost, content.photons)
            self.counts.drop("out_of_view", frames=0, photons=lost)
            self.counts.count(packets=content.packets, photons=content.photons - lost,
                              **{"frames_undeskewed" if trajectory is None else "frames_deskewed": 1})
            self.warning = cause or self.warning
        return sketches
