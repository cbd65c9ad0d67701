"""ManagedNode: the base class of the pipeline's nodes."""

import atexit
import threading
import time
from collections.abc import Callable
from typing import ClassVar

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.common.diagnostics import Diagnostics
from srt3d_ros.nodes.common.endpoints import BEST_AVAILABLE, PUBLISH_DEPTH, Endpoints, SequenceLoss
from srt3d_ros.nodes.common.parameters import Parameters, Values
from srt3d_ros.nodes.common.rclpy_patches import PatchedLifecycleNode
from srt3d_ros.nodes.common.topics import NodeSpec, Topic
from srt3d_ros.nodes.common.worker import NEWEST_ONLY, Dropped, Worker
from srt3d_ros.processes import children

SUBSCRIBE_DEPTH = PUBLISH_DEPTH
QUEUE_DEPTH = 256       # of descriptions, odometry and reports
RECORDED_DEPTH = 32     # of each input if many frames may wait: a recorder has seven inputs, with sketches of 2 MB
OUTDATED_NS = 10 * 10**9    # a frame that seems older comes from another clock and is kept


class ManagedNode(PatchedLifecycleNode):
    """A lifecycle node whose callbacks only queue messages; its worker thread processes and publishes them.

    A subclass has a method for each transition, which the executor's thread runs. If it raises, the node keeps its
    state. Every frame is either published or dropped for a named cause, and the diagnostics count both.

    Args:
        queue_limit: frames that may wait for the worker (default: only the newest).

    Attributes:
        finished: set by a node that is done: its process may end.
        stopping: set while the node stops: ends every wait of the worker.
        stop_cause: why nothing may be published; empty while active.
        received_ns: arrival of the current frame, by the node's clock.

    Raises:
        InvalidInput: a parameter cannot be used.
    """

    spec: ClassVar[NodeSpec]
    drain_s = 0.0           # how long a deactivated node still processes queued frames
    finish_s = 5.0          # deadline for a deactivation, and for the end of the node
    niceness = 0            # of the process
    reliability = BEST_AVAILABLE    # of the subscriptions to frames

    def __init__(self, queue_limit: int = NEWEST_ONLY):
        super().__init__(self.spec.name, automatically_declare_parameters_from_overrides=True)
        try:
            self.parameters = Parameters(self, self.spec.table, self.check,
                                         lambda: self.worker.call(self.apply_parameters), self.failed)
        except BaseException:
            self.destroy_node()     # a node must not outlive the context
            raise
        frames = [self.resolve_topic_name(topic.name) for topic in self.spec.outputs if not topic.latched]
        self.diagnostics = Diagnostics(self, frames[0] if frames else "",
                                       self.reliability == ReliabilityPolicy.BEST_EFFORT)
        self.endpoints = Endpoints(self)
        self.finished, self.stopping = threading.Event(), threading.Event()
        self.exit_code = 0
        self.stop_cause = "inactive"
        self.received_ns = 0
        self.worker = Worker(queue_limit, self.failed, self.diagnostics.drop)
        self._publishing = threading.Lock()
        self._problem: Exception | None = None  # why the last transition failed
        self._starting = False                  # True in `start`, and after it has failed
        # Sending times, by the sender's clock: of the last description, and of the one that frames must not precede.
        self._followed_ns = self._valid_from_ns = 0

    # ---- What a subclass overrides

    def check(self, values: Values) -> None:
        """Raise InvalidInput for parameters that cannot be used together, or now."""

    def apply_parameters(self) -> None:
        """Use the current parameters from the next frame on; the worker calls it after a change."""

    def configure(self) -> None:
        """Open files, compile kernels, create publishers."""

    def activate(self) -> None:
        """Subscribe and begin to work."""

    def forget(self) -> None:
        """Drop the state of past frames. The worker calls it at the end of a deactivation."""

    # ---- Transitions, as `ros2 lifecycle set` asks for them

    @property
    def state(self) -> str:
        """The label that `ros2 lifecycle get` shows."""
        return self.diagnostics.state

    def start(self) -> None:
        """Configure and activate; raises the exception of a step that fails."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            trigger()
            if self._problem is not None:
                raise self._problem
        self._starting = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._step(self.configure, "inactive", "configured", self.endpoints.close)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._step(self._activate, "active", "ready", self._deactivate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._step(self._deactivate, "inactive", "deactivated")

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._step(self.endpoints.close, "unconfigured", "cleaned up")

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node for good; its process waits for a signal."""
        def finalise() -> None:
            if self.state == "active":
                self._deactivate()
            self.endpoints.close()

        return self._step(finalise, "finalized", "finalized")

    def _activate(self) -> None:
        require(self.worker.finish(self.finish_s), "worker", problem="The worker still processes a frame of the last "
                "activation: activate the node again.")
        self.stopping.clear()
        self.stop_cause = ""
        self.diagnostics.begin()
        self.activate()

    def _deactivate(self) -> None:
        """Stop taking frames, finish the current one, drop or drain the queue, and forget."""
        self.stop_frames("inactive")
        self.diagnostics.wait_for("")

    def _step(self, step: Callable[[], None], state: str, done: str,
              undo: Callable[[], None] = lambda: None) -> TransitionCallbackReturn:
        """Run the method of a transition and set the state. Unless `start` runs it, log `done` or the failure."""
        self._problem = None
        try:
            try:
                step()
            except Exception:
                undo()
                raise
        except Exception as problem:
            self._problem = problem
            if not self._starting:
                self.failed(problem)
            return TransitionCallbackReturn.FAILURE
        self.diagnostics.state = state
        if not self._starting:
            self.get_logger().info(done)
        return TransitionCallbackReturn.SUCCESS

    # ---- Topics

    def subscribe(self, topic: Topic, handle: Callable[[bytes], None]) -> None:
        """Call `handle` in the worker with the bytes of each frame on an input."""
        def work(raw: bytes, sent_ns: int, received_ns: int) -> None:
            if 0 < self._valid_from_ns - sent_ns < OUTDATED_NS:
                raise Dropped("outdated", "it was sent before the current description")
            self.received_ns = received_ns
            handle(raw)

        def received(raw: bytes, info: dict) -> None:
            self.diagnostics.received(sequence.missed_before(info["publication_sequence_number"]))
            self.worker.offer(work, raw, info["source_timestamp"], self.now_ns())

        name = self.resolve_topic_name(topic.name)
        sequence = SequenceLoss(lambda: self.count_publishers(name))
        newest_only = self.worker.limit == NEWEST_ONLY
        depth = SUBSCRIBE_DEPTH * self.worker.messages_per_frame if newest_only else RECORDED_DEPTH
        self.endpoints.subscribe(topic, received, min(depth, QUEUE_DEPTH), self.reliability)
        self.diagnostics.expect(name)

    def check_size(self, sensor: SensorModel) -> SensorModel:
        """Return the sensor; InvalidInput, before memory is allocated, if it has more than `max_pixels`."""
        most = self.parameters["max_pixels"]
        require(sensor.pixels <= most, "sensor", problem=f"A sensor of {sensor.rows} × {sensor.cols} pixels exceeds "
                f"max_pixels of {self.get_name()}, {most}: set a larger one.")
        return sensor

    def follow(self, topic: Topic, handle: Callable[[bytes], None]) -> None:
        """Call `handle` in the worker with the bytes of every message on an input of descriptions.

        If `handle` raises InvalidInput while the node waits for a description, that is its problem until one comes.
        """
        def work(raw: bytes, sent_ns: int) -> None:
            self._followed_ns = sent_ns
            try:
                handle(raw)
            except InvalidInput as problem:
                if self.diagnostics.waiting_for:
                    self.diagnostics.problem = str(problem)
                raise

        self.endpoints.subscribe(topic, lambda raw, info: self.worker.call(work, raw, info["source_timestamp"]),
                                 QUEUE_DEPTH)

    def drop_older_frames(self) -> None:
        """Drop the frames that were sent before the description that `follow` handles now."""
        self._valid_from_ns = self._followed_ns

    # ---- Frames

    def hold_frames_for(self, what: str, topic: Topic) -> None:
        """Queue frames until `release_frames`, and report that they wait for `what` on an input.

        A latched description and the first frame that needs it arrive in either order.
        """
        self.diagnostics.wait_for(what, self.resolve_topic_name(topic.name))
        self.worker.hold_frames("no_sensor")

    def release_frames(self) -> None:
        """Process frames again after `hold_frames_for`; whatever kept the node from working is over."""
        self.diagnostics.wait_for("")
        self.diagnostics.problem = ""
        self.worker.release_frames()

    def publish_frame(self, publisher: Publisher, data: bytes, stamp_ns: int) -> None:
        """Publish the CDR bytes of the frame acquired at `stamp_ns`, and count it."""
        self.publish(publisher, data)
        self.sent(stamp_ns)

    def publish(self, publisher: Publisher, message: object) -> None:
        """Publish a message or its bytes; Dropped if the node has stopped since the worker began with the frame."""
        with self._publishing:
            if self.stop_cause:
                raise Dropped(self.stop_cause, "the node stopped before the frame was ready")
            publisher.publish(message)

    def sent(self, stamp_ns: int) -> None:
        """Count a frame acquired at `stamp_ns` as sent now."""
        self.diagnostics.sent((self.now_ns() - stamp_ns) * 1e-9)

    def now_ns(self) -> int:
        """Time of the node's clock, in nanoseconds; it may be simulated."""
        return self.get_clock().now().nanoseconds

    def stop_frames(self, cause: str) -> None:
        """Unsubscribe, process queued frames for `drain_s`, drop the others for `cause`, and forget.

        Returns after `finish_s` at the latest. From then on the node publishes nothing.
        """
        end_s = time.monotonic() + self.finish_s
        self.unsubscribe()
        self.stopping.set()
        if self.drain_s:
            self.worker.release_frames()
            self.worker.finish(self.drain_s)
        if (dropped := self.worker.clear(cause)) and self.drain_s:
            self.get_logger().warning(f"{dropped} messages still waited after {self.drain_s:g} s: dropped ({cause})")
        self.worker.release_frames()
        self.worker.call(self.forget)
        if not self.worker.finish(end_s - time.monotonic()):
            self.get_logger().warning(f"the current frame took more than {self.finish_s:g} s: dropped ({cause})")
        with self._publishing:
            self.stop_cause = cause

    def unsubscribe(self) -> None:
        """Destroy the subscriptions, and expect no more frames."""
        self.diagnostics.topics = ()
        self.endpoints.unsubscribe()

    def close(self) -> None:
        """Finish the current frame, publish the last diagnostics, and leave the graph."""
        if self.state in ("inactive", "active") and not (self._starting or self.finished.is_set()):
            self.get_logger().info("shutting down")     # otherwise the log already says why the node ends
        end_s = time.monotonic() + self.finish_s
        self.stop_frames("shutdown")
        if not self.worker.close(max(end_s - time.monotonic(), 0)):
            if self.drain_s > 0 and self.exit_code == 0:
                self.exit_code = 1      # queued frames are missing: a recording, say, is incomplete
            atexit.register(children.end_at_once, self.exit_code)       # other exit handlers may wait for the worker
        self.diagnostics.state = "finalized"
        self.diagnostics.close()
        self.destroy_node()

    def failed(self, error: Exception, frames: int = 0) -> None:
        """Log an error, and count it and the frames that it cost."""
        self.diagnostics.failed(error, frames)


def sensor_summary(sensor: SensorModel) -> str:
    """A sensor's pixels and bins, in words."""
    return f"{sensor.rows} × {sensor.cols} pixels, {sensor.num_bins} bins of {sensor.bin_width_s * 1e12:g} ps"
