"""PipelineNode: what all nodes of the pipeline share."""

import atexit
import threading
import time
import traceback
from collections.abc import Callable

from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.diagnostics import Diagnostics
from srt3d_ros.nodes.lifecycle import PUBLISH_DEPTH, ManagedNode, TransitionCallbackReturn
from srt3d_ros.nodes.parameters import Parameters
from srt3d_ros.nodes.topics import qos_overrides
from srt3d_ros.nodes.worker import CATCH_UP_S, NEWEST_ONLY, Dropped, Worker
from srt3d_ros.processes import children

SUBSCRIBE_DEPTH = PUBLISH_DEPTH
QUEUE_DEPTH = 256       # where frames are queued rather than dropped: more than a busy reader falls behind
FOLLOW_DEPTH = 1000     # of reports and log lines, which come from many nodes at once: as publishers of /rosout keep
OUTDATED_NS = 10 * 10**9    # a larger difference is one of clocks, not of the age of frames
LOG_EVERY_S = 2.0       # the same complaint again
POLL_S = 0.005


class PipelineNode(ManagedNode):
    """A managed node whose callbacks only pass messages to its worker thread, which processes and publishes.

    Every frame is either published or dropped for a named cause. The diagnostics count both.

    Args:
        queue_limit: frames that may wait for the worker; by default the newest only.

    Raises:
        InvalidInput: a parameter cannot be used.
    """

    drain_s = 0.0           # how long waiting frames are still processed when the node is deactivated
    queue_depth = QUEUE_DEPTH   # messages of an input that may wait in the middleware, where frames are queued
    finish_s = 5.0          # deadline for all that a deactivation or the node's end waits for
    niceness = 0            # of the process
    reliability = ReliabilityPolicy.BEST_AVAILABLE      # of the frames that come in

    def __init__(self, queue_limit: int = NEWEST_ONLY):
        super().__init__(self.spec.name, automatically_declare_parameters_from_overrides=True)
        published = [*(topic.name for topic in self.spec.outputs), "/diagnostics"]
        overrides = qos_overrides([self.resolve_topic_name(topic.name) for topic in self.spec.inputs],
                                  map(self.resolve_topic_name, published))
        try:
            self.parameters = Parameters(self, self.spec.table, overrides)
        except BaseException:
            self.destroy_node()     # it must not outlive the context
            raise
        self.parameters.on_failure = self.failed
        frames = [self.resolve_topic_name(topic.name) for topic in self.spec.outputs if not topic.latched]
        self.diagnostics = Diagnostics(self, (*frames, "")[0], self.reliability == ReliabilityPolicy.BEST_EFFORT)
        self.finished = threading.Event()       # set by a node that is done: its process may end
        self.halted = threading.Event()         # set while the node stops: the worker waits for nothing
        self.exit_code = 0
        self.stopped_for = "inactive"           # a cause for which nothing may be published; empty while active
        self._publishing = threading.Lock()
        self._tracebacks: set[tuple] = set()    # that the log has
        self.worker = Worker(queue_limit, self.failed, self.diagnostics.drop, CATCH_UP_S)
        self.received_ns = 0        # when the frame in hand came, by the node's clock
        self._followed_ns = self._valid_from_ns = 0          # when descriptions were sent, by their sender's clock

    def forget(self) -> None:
        """Drop the state of past frames; called in the worker's thread at the end of a deactivation."""

    # ---- Topics

    def subscribe(self, topic: str, handle: Callable[[bytes], None]) -> None:
        """Have the worker call `handle` with the bytes of the frames on an input, unless `drop_older` drops them."""
        def work(raw: bytes, sent_ns: int, received_ns: int) -> None:
            if 0 < self._valid_from_ns - sent_ns < OUTDATED_NS:
                raise Dropped("outdated", "it was sent before the description in force")
            self.received_ns = received_ns
            handle(raw)

        def received(raw: bytes, info: dict) -> None:
            self.diagnostics.count(message_lost=sequence.after(info["publication_sequence_number"]))
            self.diagnostics.received()
            self.worker.offer(work, raw, info["source_timestamp"], self.now_ns())

        sequence = SequenceLoss(lambda: self.count_publishers(self.resolve_topic_name(topic)))
        newest_only = self.worker.limit == NEWEST_ONLY
        depth = SUBSCRIBE_DEPTH * self.worker.messages_per_frame if newest_only else self.queue_depth
        self.make_subscription(topic, received, min(depth, QUEUE_DEPTH), True, self.reliability)
        self.diagnostics.expect(self.resolve_topic_name(topic))

    def check_size(self, sensor: SensorModel) -> SensorModel:
        """The sensor; InvalidInput if it has more than `max_pixels`, before memory is taken for it."""
        require(sensor.pixels <= self.parameters["max_pixels"], "sensor", f"{sensor.rows} × {sensor.cols} pixels",
                f"at most {self.parameters['max_pixels']}, or a larger max_pixels, a parameter of {self.get_name()}")
        return sensor

    def follow(self, topic: str, handle: Callable[[object], None]) -> None:
        """Have the worker call `handle` with every message on an input that describes or reports.

        A description that cannot be used is an error in /diagnostics until `handle` ends it with `unusable("")`.
        """
        def work(message, sent_ns: int) -> None:
            self._followed_ns = sent_ns
            try:
                handle(message)
            except InvalidInput as problem:
                self.diagnostics.unusable(str(problem))
                raise

        self.make_subscription(topic, lambda message, info: self.worker.call(work, message, info["source_timestamp"]),
                               FOLLOW_DEPTH)

    def drop_older(self) -> None:
        """Drop the frames that were sent before the description that is being followed, which replaces another."""
        self._valid_from_ns = self._followed_ns

    # ---- Frames

    def hold_frames_for(self, what: str) -> None:
        """Report that no frame can be used before `what` has come; those that may queue wait until `release_frames`.

        A latched description and the first frame it describes may arrive in either order.
        """
        self.diagnostics.wait_for(what)
        self.worker.hold_frames("no_sensor")

    def release_frames(self) -> None:
        """Process frames again after `hold_frames_for`."""
        self.diagnostics.wait_for("")
        self.worker.release_frames()

    def publish_frame(self, publisher: Publisher, data: bytes, stamp_ns: int) -> None:
        """Publish the CDR bytes of the frame acquired at `stamp_ns`."""
        self.publish(publisher, data)
        self.sent(stamp_ns)

    def publish(self, publisher: Publisher, message) -> None:
        """Publish a message; Dropped if the node was deactivated while the worker had the frame in hand."""
        with self._publishing:
            if self.stopped_for:
                raise Dropped(self.stopped_for, "it was ready only after the node had stopped")
            publisher.publish(message)

    def sent(self, stamp_ns: int) -> None:
        """Count a frame acquired at `stamp_ns` as sent now."""
        self.diagnostics.sent((self.now_ns() - stamp_ns) * 1e-9)

    def now_ns(self) -> int:
        """Nanoseconds of the node's clock, which may be a simulated one."""
        return self.get_clock().now().nanoseconds

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float = float("inf")) -> bool:
        """Wait for a condition in the worker thread, report what for, and return the condition's last value."""
        end_s = time.monotonic() + timeout_s
        self.diagnostics.wait_for(what)
        while not (met := condition()) and time.monotonic() < end_s and not self.halted.wait(POLL_S):
            pass
        self.diagnostics.wait_for("")
        return met

    def on_activate(self, state):
        if not self.worker.finish(self.finish_s):
            self.problem = InvalidInput("worker", "busy with a frame of the last activation",
                                        "it to end first: activate the node again")
            self.failed(self.problem)
            return TransitionCallbackReturn.FAILURE
        self.halted.clear()
        self.stopped_for = ""
        self.diagnostics.unusable("")
        return super().on_activate(state)

    def deactivate(self) -> None:
        """Take no more frames, finish the current one, drop those that wait unless the node drains them, and forget."""
        self.stop_frames("inactive")
        self.diagnostics.wait_for("")

    def stop_frames(self, cause: str) -> None:
        """Unsubscribe, process waiting frames for `drain_s`, drop the others for `cause`, and forget.

        After `finish_s` this returns in any case; from then on nothing is published.
        """
        end_s = time.monotonic() + self.finish_s
        self.unsubscribe()
        self.halted.set()
        if self.drain_s:
            self.worker.release_frames()
            self.worker.finish(self.drain_s)
        if (dropped := self.worker.clear(cause)) and self.drain_s:
            self.get_logger().warning(f"{dropped} messages still waited after {self.drain_s:g} s: dropped ({cause})")
        self.worker.release_frames()
        self.worker.call(self.forget)
        if not self.worker.finish(end_s - time.monotonic()):
            self.get_logger().warning(f"the work in hand took more than {self.finish_s:g} s: dropped ({cause})")
        with self._publishing:
            self.stopped_for = cause

    def unsubscribe(self) -> None:
        """Destroy the subscriptions: no frame is expected any more."""
        self.diagnostics.expect_nothing()
        super().unsubscribe()

    def close(self) -> None:
        """Finish the current frame, publish the last diagnostics, and leave the graph."""
        if self.state in ("inactive", "active") and not (self._starting or self.finished.is_set()):
            self.get_logger().info("shutting down")     # else it never started or has logged why it ends
        end_s = time.monotonic() + self.finish_s
        self.stop_frames("shutdown")
        if not self.worker.close(max(end_s - time.monotonic(), 0)):
            self.exit_code = self.exit_code or int(self.drain_s > 0)        # a recording, say, that is not complete
            atexit.register(children.end_at_once, self.exit_code)          # other handlers may wait for the worker
        self.state = "finalized"
        self.diagnostics.close()
        self.destroy_node()

    def failed(self, error: Exception, frames: int = 0) -> None:
        """Count and log an error and the frames that it cost; a mistake of ours with its traceback, once."""
        log = self.get_logger()
        if isinstance(error, Dropped):
            self.diagnostics.drop(error.cause, frames)
            log.warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
            return
        bad_input = isinstance(error, InvalidInput)
        text = str(error) if bad_input else f"{type(error).__name__}: {' '.join(str(error).split())}"
        if frames:
            self.diagnostics.drop("malformed" if bad_input else "internal", frames)
        if frames and bad_input:
            self.diagnostics.error(text, counted=False)
            log.warning(f"frame dropped: {text}", throttle_duration_sec=LOG_EVERY_S)
        elif bad_input:
            self.diagnostics.error(text)
            log.error(text, throttle_duration_sec=LOG_EVERY_S)
        else:
            self.diagnostics.internal(text)
            raised_at = tuple((part.filename, part.lineno) for part in traceback.extract_tb(error.__traceback__))
            if raised_at not in self._tracebacks:
                self._tracebacks.add(raised_at)
                log.error("".join(traceback.format_exception(error)).rstrip())
            else:
                log.error(f"again: {text}", throttle_duration_sec=LOG_EVERY_S)


class SequenceLoss:
    """Counts missed messages of one topic, whether the network lost them or newer ones pushed them out of the queue.

    The middleware's own event reports the first kind only. While a topic has several publishers, whose numbers look
    alike, nothing is counted.
    """

    def __init__(self, publishers: Callable[[], int]):
        self._publishers = publishers
        self._last: int | None = None

    def after(self, number: int | None) -> int:
        """Messages missed just before the one with this number; 0 if the middleware numbers none."""
        if number is None:
            return 0
        last, self._last = self._last, number
        missed = number - last - 1 if last is not None else 0
        return missed if missed > 0 and self._publishers() == 1 else 0      # below 0: a publisher that started again


def in_words(sensor: SensorModel) -> str:
    """A sensor's pixels and bins."""
    return f"{sensor.rows} × {sensor.cols} pixels, {sensor.num_bins} bins of {sensor.bin_width_s * 1e12:g} ps"
