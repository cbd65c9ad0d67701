"""PipelineNode: what the nodes have in common, so that each of them is its parameters, its topics and its work."""

import threading
import time
from collections.abc import Callable, Iterable

from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.diagnostics import Diagnostics
from srt3d_ros.nodes.gaps import Gaps
from srt3d_ros.nodes.parameters import Parameter, Parameters
from srt3d_ros.nodes.relay import Relay
from srt3d_ros.nodes.worker import LOSSLESS, NEWEST_ONLY, Dropped, Worker

PUBLISH_DEPTH, SUBSCRIBE_DEPTH = 5, 2
QUEUE_DEPTH = 256       # where frames are queued rather than dropped: more than a busy reader falls behind
LOG_EVERY_S = 2.0       # repeated complaints
POLL_S = 0.005
PATIENCE_S = 0.5        # a wait this long is worth a log line

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY))

LOSSLESS_PARAMETER = Parameter(
    "lossless", False, "Drop no frame: queue frames instead of keeping the newest, and publish to nobody but wait for "
    "a subscriber. For replays; a live sensor needs the newest frame.")


class PipelineNode(Node):
    """A node whose callbacks only hand messages to its worker thread, and whose worker thread publishes.

    A frame ends in exactly one way, which the diagnostics count: published, or dropped for a cause. A node of its own
    takes its parameters in the constructor and does all that may take long or fail in `configure`.

    Args:
        name: the node's name unless remapped.
        table: its parameters; with "lossless" among them the node can be told to drop nothing.
        queue_limit: frames that may wait for the worker unless lossless; by default the newest only.

    Raises:
        InvalidInput: a parameter cannot be used.
    """

    def __init__(self, name: str, table: Iterable[Parameter], queue_limit: int = NEWEST_ONLY):
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        try:
            self.parameters = Parameters(self, table)
        except BaseException:
            self.destroy_node()     # a node that nobody will ever see must not outlive the context
            raise
        self.lossless = bool(self.parameters.as_dict().get("lossless", False))
        self.diagnostics = Diagnostics(self)
        self.stopping = threading.Event()       # set by a node that is done, and by close()
        self.exit_code = 0
        self.worker = Worker(LOSSLESS if self.lossless else queue_limit, self._failed, self.diagnostics.drop)
        self._stages = [self.worker]
        self._relay = Relay(self.get_logger())

    def configure(self) -> None:
        """Open, compile, advertise and, last, subscribe; InvalidInput if an input or a parameter cannot be used."""
        raise NotImplementedError

    def add_stage(self) -> Worker:
        """A worker that goes on with frames where the last one leaves off; it drops none."""
        self._stages.append(Worker(LOSSLESS, self._failed, self.diagnostics.drop))
        return self._stages[-1]

    def subscribe(self, message_type: type, topic: str, handle: Callable[[bytes], None]) -> None:
        """Have the worker call `handle` with the CDR bytes of the frames on `topic`."""
        gaps = Gaps(lambda: subscription.get_publisher_count())

        def received(raw: bytes, info: dict) -> None:
            self.diagnostics.lost(gaps.after(info["publication_sequence_number"]))
            self.diagnostics.received()
            self.worker.offer(handle, raw)

        def lost(event) -> None:
            if not gaps.numbered:       # or they would be counted twice
                self.diagnostics.lost(event.total_count_change)

        qos = QoSProfile(depth=SUBSCRIBE_DEPTH if self.worker.limit == NEWEST_ONLY else QUEUE_DEPTH)
        options = {"raw": True, "qos_overriding_options": OVERRIDABLE}
        try:
            events = SubscriptionEventCallbacks(message_lost=lost)
            subscription = self.create_subscription(message_type, topic, received, qos, event_callbacks=events,
                                                    **options)
        except UnsupportedEventTypeError:       # a middleware that cannot tell
            subscription = self.create_subscription(message_type, topic, received, qos, **options)

    def subscribe_latched(self, message_type: type, topic: str, handle: Callable[[object], None]) -> None:
        """Have the worker call `handle` with the message that describes what follows; it is never dropped."""
        self.create_subscription(message_type, topic, lambda message: self.worker.call(handle, message), LATCHED,
                                 qos_overriding_options=OVERRIDABLE)

    def advertise(self, message_type: type, topic: str) -> Publisher:
        """A publisher of frames."""
        depth = QUEUE_DEPTH if self.lossless else PUBLISH_DEPTH
        return self.create_publisher(message_type, topic, QoSProfile(depth=depth), qos_overriding_options=OVERRIDABLE)

    def advertise_latched(self, message_type: type, topic: str) -> Publisher:
        """A publisher whose last message also reaches those who subscribe later."""
        return self.create_publisher(message_type, topic, LATCHED, qos_overriding_options=OVERRIDABLE)

    def hold_frames_for(self, what: str) -> None:
        """Say that no frame can be used before `what` has come; those that may queue wait until `release_frames`."""
        self.diagnostics.wait_for(what)
        if self.worker.limit > NEWEST_ONLY:
            self.worker.hold_frames()

    def release_frames(self) -> None:
        """What frames were held for has come."""
        self.diagnostics.wait_for("")
        self.worker.release_frames()

    def publish_frame(self, publisher: Publisher, data: bytes, stamp_ns: int) -> None:
        """Publish the CDR bytes of the frame acquired at `stamp_ns`; when lossless, wait for a subscriber first."""
        if self.lossless:
            self.wait_until(lambda: publisher.get_subscription_count() > 0, f"a subscriber on {publisher.topic_name}")
        publisher.publish(data)
        self.sent(stamp_ns)

    def sent(self, stamp_ns: int) -> None:
        """A frame acquired at `stamp_ns` has left this node, now."""
        self.diagnostics.sent((self.now_ns() - stamp_ns) * 1e-9)

    def now_ns(self) -> int:
        """Nanoseconds of the node's clock, which may be a simulated one."""
        return self.get_clock().now().nanoseconds

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float = float("inf")) -> bool:
        """Wait, in the worker thread, for a condition; say so if it takes long. False if it never held."""
        started, told = time.monotonic(), False
        while not (met := condition()) and not self.stopping.wait(POLL_S):
            waited_s = time.monotonic() - started
            if waited_s >= timeout_s:
                break
            if waited_s >= PATIENCE_S and not told:
                told = True
                self.diagnostics.wait_for(what)
                self.get_logger().info(f"waiting for {what}")
        if told:
            self.diagnostics.wait_for("")
        return met

    def close(self, drain: bool = False) -> None:
        """Finish the frame in hand (with `drain` all that wait), publish the last diagnostics, leave the graph."""
        self.stopping.set()
        for first, stage in enumerate(self._stages):
            stage.close(drain or first > 0)
        self.diagnostics.close()
        self._relay.close()
        self.destroy_node()

    def _failed(self, error: Exception, is_frame: bool) -> None:
        if isinstance(error, Dropped):
            self.diagnostics.drop(error.cause)
            self.get_logger().warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
            return
        bad_input = isinstance(error, InvalidInput)
        text = str(error) if bad_input else f"{type(error).__name__}: {' '.join(str(error).split())}"
        if is_frame:
            self.diagnostics.drop("malformed" if bad_input else "error")
        if is_frame and bad_input:
            self.diagnostics.note(text)
            self.get_logger().warning(f"frame dropped: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self.diagnostics.error(text)
            self.get_logger().error(text, throttle_duration_sec=LOG_EVERY_S)
