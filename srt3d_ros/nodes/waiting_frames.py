"""WaitingFrames: frames that have ended and wait until the sensor's motion during them is known."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from srt3d_ros.core.framing import OpenFrame
from srt3d_ros.core.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode
from srt3d_ros.nodes.motion_input import MotionInput

TIMEOUT_S = 1.0                 # odometry comes some 10 to 100 ms late; what is not here after that has stopped
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
        failed: called with what a frame was lost to, its packets and its photons.
    """

    def __init__(self, node: PipelineNode, failed: Callable[[Exception, int, int], None]):
        self._node, self._failed = node, failed
        self._frames: deque[Waiting] = deque()
        self._waking = False                # whether `_wake` will be called
        self._undeskewed = 0, ""            # frames since the last report, and the last one's cause
        self._motion = MotionInput(node, self.release, lambda: bool(self._frames))
        node.diagnostics.count(frames_deskewed=0, frames_undeskewed=0, motion_refused=0, motion_restarts=0)
        node.diagnostics.find_warning = self._warning

    def add(self, frame: OpenFrame, parts: MovingFrame, sketcher: MovingSketcher,
            publish: Callable[[Sketch, int], None]) -> None:
        """Have a frame wait, and those go on that need not."""
        self._frames.append(Waiting(frame, parts, sketcher, publish, time.monotonic() + TIMEOUT_S))
        self.release()

    def release(self) -> None:
        """Finish the frames whose motion is known, or will not be in time."""
        self._motion.update()
        while self._frames and self._finish(crowded([waiting.parts for waiting in self._frames])):
            pass
        if self._frames and not self._waking:
            self._waking = True
            self._node.worker.call_after(max(self._frames[0].until_s - time.monotonic(), 0), self._wake)

    def flush(self) -> None:
        """Finish all frames: nothing is waited for any more."""
        self._motion.update()
        while self._frames:
            self._finish(at_once=True)

    def _wake(self) -> None:
        self._waking = False
        self.release()

    def _finish(self, at_once: bool) -> bool:
        """Finish the first frame, at once or if it need not wait; whether it is finished."""
        waiting, ranges = self._frames[0], None
        parts, sketcher = waiting.parts, waiting.sketcher
        trajectory, cause = self._motion.trajectory(parts, at_once or time.monotonic() >= waiting.until_s)
        if trajectory is None and not cause:
            return False
        self._frames.popleft()
        try:
            if trajectory is not None:
                ranges = self._motion.ranges(parts.to_ns, sketcher.sensor, trajectory)
            waiting.publish(sketcher.finish(parts, trajectory, ranges), sketcher.lost)
        except Exception as error:
            self._failed(error, *waiting.frame)
            return True
        if trajectory is None:
            self._node.diagnostics.count(frames_undeskewed=1)
            self._undeskewed = self._undeskewed[0] + 1, cause
            self._node.get_logger().warning(f"frame goes on undeskewed: {cause}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self._node.diagnostics.count(frames_deskewed=1, frames_with_parallax=int(ranges is not None))
        return True

    def _warning(self) -> str:
        """What was undeskewed since the last report."""
        (frames, cause), self._undeskewed = self._undeskewed, (0, "")
        return f"{frames} frames undeskewed: {cause}" if frames else ""


def crowded(frames: Sequence[MovingFrame]) -> bool:
    """Whether so many frames wait that the first has to go on."""
    return len(frames) > MOST and sum(sketch.sums.nbytes for frame in frames for _, sketch in frame.parts) > MOST_BYTES
