"""SketchStream: packets of photons in, sketches of frames out, for nodes, library, bags and evaluation."""

from collections import deque
from dataclasses import dataclass, field, replace

from srt3d_ros.core.motion.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.motion.track import MotionReport, SensorMotion
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.counts import Counts
from srt3d_ros.core.sketching.design import SketchDesign, design_sketch
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, check_window
from srt3d_ros.core.sketching.framing import Framing, OpenFrame
from srt3d_ros.core.sketching.gate import OFF, in_ranges
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.errors import require

MERGE_S = 0.4           # longest wait for an acknowledgement; a killed reader would block for 20 s
MERGE_POLL_S = 0.01     # between tries to send a merged frame: costs 1 % of a core while one waits
MOTION_S = 1.0          # longest wait for motion: odometry comes 10 to 100 ms late; after a second it has stopped
MOST_FRAMES, MOST_BYTES = 4, 2**28      # frames that may wait for motion; more while all take less memory than this


@dataclass(frozen=True)
class StreamOptions:
    """How packets become frames, and frames sketches.

    Args:
        gate, frequencies, sketch_size: see `design_sketch`.
        packets_per_frame, frame_period_ns: as of Framing.
        window_frames: frames in the sliding window of a sketch.
        moving: deskew each frame to the sensor's pose in its middle, with the reports given to `add_motion`.
        extrinsics: the pose of the sensor in the frame of the reported body.
        merge_when_busy: while readers are busy, add new frames to the one that waits.
    """

    gate: str = OFF
    frequencies: str = "auto"
    sketch_size: int | None = None
    packets_per_frame: int = 1
    frame_period_ns: int = 0
    window_frames: int = 1
    moving: bool = False
    extrinsics: Pose = field(default_factory=Pose, compare=False)
    merge_when_busy: bool = False

    def __post_init__(self) -> None:
        require(self.window_frames == 1 or not self.moving, "window_frames", self.window_frames,
                "1 with motion, which has frames seen from different places")
        require(not self.merge_when_busy or (self.window_frames == 1 and not self.moving), "merge_when_busy", "true",
                "false with motion or window_frames above 1, whose sketches do not add up")

    def check(self, sensor: SensorModel) -> SketchDesign:
        """The design for a sensor; InvalidInput if the options do not suit it."""
        design = design_sketch(sensor, self.gate, self.frequencies, self.sketch_size)
        check_window(self.window_frames, sensor, design.frequencies)
        return design


@dataclass(eq=False)
class _Ended:
    """A frame that ended at `since_s`: packets and photons, `kept` photons inside the gate, and its sketch.

    The sketch of a moving sensor is None until its `parts` are deskewed.
    """

    content: OpenFrame
    kept: int
    since_s: float
    sketch: PhaseSums | None
    parts: MovingFrame | None = None

    def with_next(self, other: "_Ended") -> "_Ended":
        """Both frames as one."""
        content = OpenFrame(*map(sum, zip(self.content, other.content)))
        return replace(self, content=content, kept=self.kept + other.kept, sketch=self.sketch + other.sketch)


class SketchStream:
    """Sketches the frames of one sensor. Calls never block; one thread at a time.

    Every packet and photon is in a returned sketch, in an open or waiting frame, or counted as dropped for a cause.

    Args:
        sensor: of the photons that come in.
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
        self._moving = MovingSketcher(sensor, frequencies, gate) if options.moving else None
        self._sketcher = self._moving or FrameSketcher(sensor, frequencies, options.window_frames, gate)
        self._motion = SensorMotion(options.extrinsics) if options.moving else None
        self._ended: deque[_Ended] = deque()
        self._merged: _Ended | None = None          # sum of the frames that wait for readers
        self._came_s = self._sent_s = -float("inf")
        self.packets_per_frame = options.packets_per_frame

    # ---- Input

    def push(self, packet: PhotonFrame, now_s: float = 0.0, busy: bool = False) -> list[PhaseSums]:
        """Add a packet; returns the sketches that are finished.

        Args:
            now_s: the time, of the same clock as for `poll`.
            busy: whether readers still have to take earlier sketches.

        Raises:
            InvalidInput: photons outside the sensor. The packet changes nothing.
        """
        packet.check(self.sensor)       # first: a bad packet's stamp must not end a frame
        self.counts.count(photons_in=packet.photons)
        self._came_s = now_s
        placed = self._framing.place(packet.stamp_ns)
        self._end_frame(placed.ended, now_s)
        if placed.began_again:
            self.counts.count(stamp_leaps=1)
            self._forget(placed.forgotten)
        if placed.late:
            self.counts.drop("late", photons=packet.photons)
        else:
            self._sketcher.add(packet)
            self._end_frame(self._framing.add(packet.stamp_ns, packet.photons), now_s)
        return self.poll(now_s, busy)

    def add_motion(self, report: MotionReport) -> str:
        """Add a report of motion; see `SensorMotion.add`."""
        return self._motion.add(report)

    # ---- Output

    def poll(self, now_s: float = 0.0, busy: bool = False) -> list[PhaseSums]:
        """The sketches finished by now: of frames that end by silence, and of those that need not wait longer."""
        if self.options.frame_period_ns and now_s - self._came_s > self._framing.silence_ns * 1e-9:
            self._end_frame(self._framing.flush(), now_s)
        return self._take(now_s, busy)

    @property
    def waits_for_motion(self) -> bool:
        """Whether ended frames wait for reports of motion."""
        return bool(self._ended)

    @property
    def wait_s(self) -> float | None:
        """Seconds until the next `poll` is due if nothing is pushed; None while nothing waits."""
        if self._merged is not None:
            return MERGE_POLL_S
        if self._ended:
            return 0.0 if self._motion is None else MOTION_S
        if self._framing.open.packets and self.options.frame_period_ns:
            return self._framing.silence_ns * 1e-9
        return None

    def reset(self) -> list[PhaseSums]:
        """Drop the open frame as `incomplete` and begin a new window; returns the sketches of ended frames."""
        sketches = self._take(at_once=True)
        self._forget(self._framing.clear())
        return sketches

    def flush(self) -> list[PhaseSums]:
        """End the open frame, unless it waits for its number of packets; returns all sketches."""
        self._end_frame(self._framing.flush(), self._came_s)
        return self.reset()

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
                "window_frames": self.options.window_frames, "gate": in_ranges(self._sketcher.gate),
                "frequencies": " ".join(map(str, self._sketcher.frequencies))}

    # ---- Frames

    def _forget(self, frame: OpenFrame | None) -> None:
        """Begin a new window; counts the open frame, if any, as dropped."""
        if frame is not None:
            self.counts.drop("incomplete", *frame)
        self._sketcher.reset()

    def _end_frame(self, frame: OpenFrame | None, now_s: float) -> None:
        """Sketch a frame that ended, if any."""
        if frame is not None:
            self.packets_per_frame, sketcher = frame.packets, self._sketcher
            kept = frame.photons if sketcher.gate is None else min(sketcher.kept, frame.photons)
            sketch, parts = (sketcher.end_frame(), None) if self._moving is None else (None, self._moving.end_frame())
            self._ended.append(_Ended(frame, kept, now_s, sketch, parts))

    def _take(self, now_s: float = 0.0, busy: bool = False, at_once: bool = False) -> list[PhaseSums]:
        """The sketches of the frames that need not wait longer, in order."""
        sketches = []
        while self._ended and self._finish(self._ended[0], now_s, at_once):
            frame = self._ended.popleft()
            if self.options.merge_when_busy:
                self._merged = frame if self._merged is None else self._merged.with_next(frame)
            else:
                sketches.append(self._release(frame, now_s))
        if self._merged is not None and (at_once or not busy or not 0 <= now_s - self._sent_s < MERGE_S):
            sketches.append(self._release(self._merged, now_s))
        return sketches

    def _release(self, frame: _Ended, now_s: float) -> PhaseSums:
        """Count a frame as out; returns its sketch."""
        self._merged, self._sent_s = None, now_s
        self.counts.count(packets=frame.content.packets, photons=frame.kept)
        self.counts.drop("gate", frames=0, photons=frame.content.photons - frame.kept)
        return frame.sketch

    def _finish(self, frame: _Ended, now_s: float, at_once: bool) -> bool:
        """Whether a frame need not wait longer for motion; deskews its sketch then, if the motion is known."""
        if self._motion is None:
            return True
        nbytes = sum(ended.parts.nbytes for ended in self._ended)
        exceeds_memory = len(self._ended) > MOST_FRAMES and nbytes > MOST_BYTES
        late = at_once or exceeds_memory or not 0 <= now_s - frame.since_s < MOTION_S
        trajectory, cause = self._motion.over(frame.parts.first_ns, frame.parts.last_ns, late)
        if trajectory is None and not cause:
            return False
        frame.sketch = self._moving.finish(frame.parts, trajectory)
        lost = min(self._moving.lost, frame.kept)
        frame.kept -= lost
        frame.content = frame.content._replace(photons=frame.content.photons - lost)
        self.counts.drop("out_of_view", frames=0, photons=lost)
        if trajectory is None:
            self.warning = cause
            self.counts.count(frames_undeskewed=1)
        else:
            self.counts.count(frames_deskewed=1)
        return True
