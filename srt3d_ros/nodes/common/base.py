"""PipelineNode: the base class of the pipeline's nodes."""

import atexit
import threading
import time
import traceback
from collections.abc import Callable

from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.common.diagnostics import Diagnostics
from srt3d_ros.nodes.common.lifecycle import PUBLISH_DEPTH, ManagedNode, TransitionCallbackReturn
from srt3d_ros.nodes.common.parameters import Parameters
from srt3d_ros.nodes.common.topics import qos_overrides
from srt3d_ros.nodes.common.worker import CATCH_UP_S, NEWEST_ONLY, Dropped, Worker
from srt3d_ros.processes import children

SUBSCRIBE_DEPTH = PUBLISH_DEPTH
QUEUE_DEPTH = 256       # of inputs whose frames are queued rather than dropped
FOLLOW_DEPTH = 1000     # of reports and log lines, which many nodes send at once: the depth of /rosout's publishers
OUTDATED_NS = 10 * 10**9    # a frame that seems older comes from another clock and is kept
LOG_EVERY_S = 2.0       # at most, the same line
POLL_S = 0.005


class PipelineNode(ManagedNode):
    """A managed node whose callbacks only queue messages; its worker thread processes and publishes them.

    Every frame is either published or dropped for a named cause, and the diagnostics count both.

    Args:
        queue_limit: frames that may wait for the worker (default: only the newest).

    Raises:
        InvalidInput: a parameter cannot be used.
    """

    drain_s = 0.0           # how long a deactivated node still processes queued frames
    queue_depth = QUEUE_DEPTH   # messages per input that the middleware queues if `queue_limit` is larger than 1
    finish_s = 5.0          # deadline for a deactivation, and for the end of the node
    niceness = 0            # of the process
    reliability = ReliabilityPolicy.BEST_AVAILABLE      # of the subscriptions to frames

    def __init__(self, queue_limit: int = NEWEST_ONLY):
        super().__init__(self.spec.name, automatically_declare_parameters_from_overrides=True)
        published = [*(topic.name for topic in self.spec.outputs), "/diagnostics"]
        overrides = qos_overrides([self.resolve_topic_name(topic.name) for topic in self.spec.inputs],
                                  map(self.resolve_topic_name, published))
        try:
            self.parameters = Parameters(self, self.spec.table, overrides)
        except BaseException:
            self.destroy_node()     # a node must not outlive the context
            raise
        self.parameters.on_failure = self.failed
        frames = [self.resolve_topic_name(topic.name) for topic in self.spec.outputs if not topic.latched]
        self.diagnostics = Diagnostics(self, frames[0] if frames else "",
                                       self.reliability == ReliabilityPolicy.BEST_EFFORT)
        self.finished = threading.Event()       # set by a node that is done: its process may end
        self.stopping = threading.Event()       # set while the node stops: ends every wait of the worker
        self.exit_code = 0
        self.stop_cause = "inactive"            # why nothing may be published; empty while active
        self._publishing = threading.Lock()
        self._tracebacks: set[tuple] = set()    # places whose traceback has been logged
        self.worker = Worker(queue_limit, self.failed, self.diagnostics.drop, CATCH_UP_S)
        self.received_ns = 0        # arrival of the current frame, by the node's clock
        # Sending times, by the sender's clock: of the last description, and of the one that frames must not precede.
        self._followed_ns = self._valid_from_ns = 0

    def forget(self) -> None:
        """Drop the state of past frames. The worker calls it at the end of a deactivation."""

    # ---- Topics

    def subscribe(self, topic: str, handle: Callable[[bytes], None]) -> None:
        """Call `handle` in the worker with the bytes of each frame on an input."""
        def work(raw: bytes, sent_ns: int, received_ns: int) -> None:
            if 0 < self._valid_from_ns - sent_ns < OUTDATED_NS:
                raise Dropped("outdated", "it was sent before the current description")
            self.received_ns = received_ns
            handle(raw)

        def received(raw: bytes, info: dict) -> None:
            self.diagnostics.count(message_lost=sequence.missed_before(info["publication_sequence_number"]))
            self.diagnostics.received()
            self.worker.offer(work, raw, info["source_timestamp"], self.now_ns())

        sequence = SequenceLoss(lambda: self.count_publishers(self.resolve_topic_name(topic)))
        newest_only = self.worker.limit == NEWEST_ONLY
        depth = SUBSCRIBE_DEPTH * self.worker.messages_per_frame if newest_only else self.queue_depth
        self.make_subscription(topic, received, min(depth, QUEUE_DEPTH), True, self.reliability)
        self.diagnostics.expect(self.resolve_topic_name(topic))

    def check_size(self, sensor: SensorModel) -> SensorModel:
        """Return the sensor; InvalidInput, before memory is allocated, if it has more than `max_pixels`."""
        most = self.parameters["max_pixels"]
        require(sensor.pixels <= most, "sensor", problem=f"A sensor of {sensor.rows} × {sensor.cols} pixels exceeds "
                f"max_pixels of {self.get_name()}, {most}: set a larger one.")
        return sensor

    def follow(self, topic: str, handle: Callable[[object], None]) -> None:
        """Call `handle` in the worker with every message on an input of descriptions, reports or log lines.

        If `handle` raises InvalidInput while the node waits for a description, that is its problem until one comes.
        """
        def work(message, sent_ns: int) -> None:
            self._followed_ns = sent_ns
            try:
                handle(message)
            except InvalidInput as problem:
                if self.diagnostics.waiting_for:
                    self.diagnostics.problem = str(problem)
                raise

        self.make_subscription(topic, lambda message, info: self.worker.call(work, message, info["source_timestamp"]),
                               FOLLOW_DEPTH)

    def drop_older_frames(self) -> None:
        """Drop the frames that were sent before the description that `follow` handles now."""
        self._valid_from_ns = self._followed_ns

    # ---- Frames

    def hold_frames_for(self, what: str, topic: str) -> None:
        """Queue frames until `release_frames`, and report that they wait for `what` on an input.

        A latched description and the first frame that needs it arrive in either order.
        """
        self.diagnostics.wait_for(what, self.resolve_topic_name(topic))
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

    def publish(self, publisher: Publisher, message) -> None:
        """Publish a message; Dropped if the node has stopped since the worker began with the frame."""
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

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float = float("inf")) -> bool:
        """Wait in the worker for a condition, report `what` it waits for, and return the condition's last value."""
        end_s = time.monotonic() + timeout_s
        self.diagnostics.wait_for(what)
        while not (met := condition()) and time.monotonic() < end_s and not self.stopping.wait(POLL_S):
            pass
        self.diagnostics.wait_for("")
        return met

    def on_activate(self, state):
        if not self.worker.finish(self.finish_s):
            self.problem = InvalidInput("worker", problem="The worker still processes a frame of the last activation: "
                                                         "activate the node again.")
            self.failed(self.problem)
            return TransitionCallbackReturn.FAILURE
        self.stopping.clear()
        self.stop_cause = ""
        self.diagnostics.degraded = ""
        self.diagnostics.clear()
        return super().on_activate(state)

    def deactivate(self) -> None:
        """Stop taking frames, finish the current one, drop or drain the queue, and forget."""
        self.stop_frames("inactive")
        self.diagnostics.wait_for("")

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
        self.diagnostics.expect_nothing()
        super().unsubscribe()

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
        self.state = "finalized"
        self.diagnostics.close()
        self.destroy_node()

    def failed(self, error: Exception, frames: int = 0) -> None:
        """Log an error, and count it and the frames that it cost."""
        if isinstance(error, Dropped):
            self.diagnostics.drop(error.cause, frames)
            self.get_logger().warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
        elif isinstance(error, InvalidInput):
            self._bad_input(str(error), frames)
        else:
            self._internal_error(error, frames)

    def _bad_input(self, text: str, frames: int) -> None:
        self.diagnostics.error(text, counted=not frames)
        if frames:
            self.diagnostics.drop("malformed", frames)
            self.get_logger().warning(f"frame dropped: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self.get_logger().error(text, throttle_duration_sec=LOG_EVERY_S)

    def _internal_error(self, error: Exception, frames: int) -> None:
        """Count and log a bug of this package: its traceback once, then a line each time."""
        if frames:
            self.diagnostics.drop("internal", frames)
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        self.diagnostics.internal(text)
        raised_at = tuple((part.filename, part.lineno) for part in traceback.extract_tb(error.__traceback__))
        if raised_at in self._tracebacks:
            self.get_logger().error(f"again: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self._tracebacks.add(raised_at)
            self.get_logger().error("".join(traceback.format_exception(error)).rstrip())


class SequenceLoss:
    """Counts the messages of one topic that a subscription has missed.

    They were lost by the network or dropped from a full queue; the middleware's own event reports only the former. With
    several publishers on the topic, whose numbers cannot be told apart, nothing is counted.
    """

    def __init__(self, publishers: Callable[[], int]):
        self._publishers = publishers
        self._last: int | None = None

    def missed_before(self, number: int | None) -> int:
        """Messages missed just before the one with this sequence number; 0 if the middleware gives none."""
        if number is None:
            return 0
        last, self._last = self._last, number
        missed = number - last - 1 if last is not None else 0
        return missed if missed > 0 and self._publishers() == 1 else 0      # below 0: the publisher restarted


def sensor_summary(sensor: SensorModel) -> str:
    """A sensor's pixels and bins, in words."""
    return f"{sensor.rows} × {sensor.cols} pixels, {sensor.num_bins} bins of {sensor.bin_width_s * 1e12:g} ps"
