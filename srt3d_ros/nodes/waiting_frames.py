"""WaitingFrames: frames that have ended and wait until the sensor's motion during them is known."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from srt3d_ros.core.framing import OpenFrame
from srt3d_ros.core.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode
from srt3d_ros.nodes.estimated_motion import EstimatedMotion
from srt3d_ros.nodes.motion_input import ESTIMATE, MotionInput

MOST, MOST_BYTES = 4, 2**28     # frames that wait whatever they take, and the memory that more of them may take


@dataclass(frozen=True, eq=False)
class Waiting:
    """A frame that waits.

    Args:
        frame: its packets and photons.
        parts: what is to be moved, by its sketcher.
        publish: publishes the sketch, and counts the photons that moved out of view.
        until_s: of time.monotonic().
    """

    frame: OpenFrame
    parts: MovingFrame
    sketcher: MovingSketcher
    publish: Callable[[Sketch, int], None]
    until_s: float


class WaitingFrames:
    """Finishes frames in their order. Each waits for reports of the sensor's motion, but not for long.

    The time is real time, also where the node's clock is a simulated one: that one stands while a player waits for
    this very frame. All methods are called in the worker's thread.

    Args:
        node: with the parameter `motion_timeout_s`.
        failed: called with what a frame was lost to, its packets and its photons.
    """

    def __init__(self, node: PipelineNode, failed: Callable[[Exception, int, int], None]):
        self._node, self._failed = node, failed
        self._frames: deque[Waiting] = deque()
        self._timed: Waiting | None = None          # the frame that the timer is for
        self._timer: threading.Timer | None = None
        self._undeskewed = 0, ""            # frames since the last report, and the last one's cause
        source = EstimatedMotion if node.parameters["motion"] == ESTIMATE else MotionInput
        self._motion = source(node, self.release, lambda: bool(self._frames))
        node.diagnostics.count(frames_deskewed=0, frames_undeskewed=0, motion_refused=0, motion_restarts=0)
        node.diagnostics.find_warning = self._warning

    @property
    def open(self) -> OpenFrame:
        """Packets and photons of the frames that wait."""
        frames = list(self._frames)
        return OpenFrame(sum(one.frame.packets for one in frames), sum(one.frame.photons for one in frames))

    def expect(self, sensor: SensorModel) -> None:
        """Expect frames of this sensor."""
        self._motion.of(sensor)

    def add(self, frame: OpenFrame, parts: MovingFrame, sketcher: MovingSketcher, frame_id: str,
            publish: Callable[[Sketch, int], None]) -> None:
        """Have a frame whose tf frame is `frame_id` wait, and those go on that need not."""
        self._motion.of(sketcher.sensor, frame_id)
        until_s = time.monotonic() + self._node.parameters["motion_timeout_s"]
        self._frames.append(Waiting(frame, parts, sketcher, publish, until_s))
        self.release()

    def release(self) -> None:
        """Finish the frames whose motion is known, or will not be in time."""
        self._motion.update()
        while self._frames and self._finish(crowded([waiting.parts for waiting in self._frames])):
            pass
        self._wake_later()

    def flush(self) -> None:
        """Finish all frames: nothing is waited for any more."""
        self._motion.update()
        while self._frames:
            self._finish(at_once=True)
        self._wake_later()

    def _finish(self, at_once: bool) -> bool:
        """Finish the first frame, at once or if it need not wait; whether it is finished."""
        waiting = self._frames[0]
        parts, count, ranges = waiting.parts, self._node.diagnostics.count, None
        late = at_once or time.monotonic() >= waiting.until_s
        trajectory = cause = None
        try:
            trajectory, cause = self._motion.trajectory(parts, waiting.sketcher, late)
            if trajectory is None and not cause:
                return False
        except Exception as error:      # a frame is never stuck
            cause = str(error)
        self._frames.popleft()
        try:
            if trajectory is not None:
                ranges = self._motion.ranges(parts.to_ns, trajectory)
            sketch = waiting.sketcher.finish(parts, trajectory, ranges)
            waiting.publish(sketch, waiting.sketcher.lost)
        except Exception as error:
            self._failed(error, *waiting.frame)
            return True
        if trajectory is None:
            count(frames_undeskewed=1)
            self._undeskewed = self._undeskewed[0] + 1, cause
            self._node.get_logger().warning(f"frame goes on undeskewed: {cause}", throttle_duration_sec=LOG_EVERY_S)
        else:
            count(frames_deskewed=1, **({} if ranges is None else {"frames_with_parallax": 1}))
        return True

    def _warning(self) -> str:
        """What was undeskewed since the last report."""
        (frames, cause), self._undeskewed = self._undeskewed, (0, "")
        return f"{frames} frames undeskewed: {cause}" if frames else ""

    def _wake_later(self) -> None:
        """Have the worker look again when the first frame must not wait any longer."""
        first = self._frames[0] if self._frames else None
        if first is self._timed:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timed, self._timer = first, None
        if first is not None:
            self._timer = self._node.worker.call_after(max(first.until_s - time.monotonic(), 0), self.release)


def crowded(frames: Sequence[MovingFrame]) -> bool:
    """Whether so many frames wait that the first has to go on."""
    return len(frames) > MOST and sum(sketch.sums.nbytes for frame in frames for _, sketch in frame.parts) > MOST_BYTES
