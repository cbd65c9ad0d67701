"""PipelineNode: what the nodes have in common, so that each of them is its tables, its topics and its work."""

import threading
import time
from collections.abc import Callable
from functools import partial

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from std_srvs.srv import Trigger

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.diagnostics import Diagnostics
from srt3d_ros.nodes.lifecycle import ManagedNode
from srt3d_ros.nodes.log_forwarding import LogForwarding
from srt3d_ros.nodes.node_spec import NodeSpec, Topic
from srt3d_ros.nodes.parameters import Parameter, Parameters
from srt3d_ros.nodes.qos import LATCHED, OVERRIDABLE, overrides
from srt3d_ros.nodes.sequence_loss import SequenceLoss
from srt3d_ros.nodes.worker import LOSSLESS, NEWEST_ONLY, PATIENCE_S, Dropped, Worker

PUBLISH_DEPTH = SUBSCRIBE_DEPTH = 8     # messages of 10 ms for as long as a thread may have to wait for its turn
QUEUE_DEPTH = 256       # where frames are queued rather than dropped: more than a busy reader falls behind
FOLLOW_DEPTH = 100      # of reports, which come from many nodes at once
OUTDATED_NS = 10 * 10**9    # a difference of more is of clocks, not of frames under way
LOG_EVERY_S = 2.0       # repeated complaints
POLL_S = 0.005
TELL_AFTER_S = 0.5      # a wait this long is worth a log line


class PipelineNode(ManagedNode):
    """A managed node whose callbacks only hand messages to its worker thread, and whose worker thread publishes.

    Every frame is either published or dropped for a named cause. The diagnostics count both (frame_accounting.py). A
    subclass takes its parameters in the constructor, does all that may take long or fail in `configure`, subscribes in
    `activate`, and forgets past frames in `forget`.

    Args:
        queue_limit: frames that wait for a worker that does not keep up, unless lossless; by default the newest only.

    Raises:
        InvalidInput: a parameter cannot be used.
    """

    spec: NodeSpec
    drains = False          # whether frames that wait are still worked on when the node is deactivated
    queue_depth = QUEUE_DEPTH   # messages of an input that may wait in the middleware, where frames are queued
    finish_s = 5.0          # how long the frame in hand, or what drains, may take then

    def __init__(self, queue_limit: int = NEWEST_ONLY):
        super().__init__(self.spec.name, automatically_declare_parameters_from_overrides=True)
        try:
            self.parameters = Parameters(self, self.spec.table, self._qos_overrides())
        except BaseException:
            self.destroy_node()     # a node that nobody will ever see must not outlive the context
            raise
        self.lossless = bool(self.parameters.as_dict().get("lossless", False))
        self.diagnostics = Diagnostics(self, self.spec.balances)
        self.finished = threading.Event()       # set by a node that is done: its process may end
        self.halted = threading.Event()         # set while the worker is to wait for nothing: the node is being stopped
        self.exit_code = 0
        limit = LOSSLESS if self.lossless else queue_limit
        self.worker = Worker(limit, self._failed, self.diagnostics.drop, PATIENCE_S, self._audit)
        self._stages = [self.worker]
        self._held_for = self._stopped_for = ""
        self._followed_ns = self._valid_from_ns = 0         # when descriptions were sent, by their sender's clock
        self._listening: list[Subscription] = []
        self._advertised: list[Publisher] = []
        self._serving: list[Service] = []
        self._services_group = ReentrantCallbackGroup()     # a service that waits holds up nothing else
        self._relay = LogForwarding(self.get_logger())

    def _qos_overrides(self) -> list[Parameter]:
        names = [[self.resolve_topic_name(topic.name) for topic in topics]
                 for topics in (self.spec.inputs, self.spec.outputs)]
        return list(overrides(names[0], [*names[1], self.resolve_topic_name("/diagnostics")]))

    def forget(self) -> None:
        """Let nothing of past frames remain; called in the worker's thread, on a reset and when deactivated."""

    def add_stage(self) -> Worker:
        """A worker that goes on with frames where the last one leaves off; it drops none."""
        self._stages.append(Worker(LOSSLESS, self._failed, self.diagnostics.drop, done=self._audit))
        return self._stages[-1]

    def open_frame(self) -> tuple[int, int]:
        """Messages, and photons in them, that the node keeps for a frame which is not complete yet."""
        return 0, 0

    def _audit(self) -> None:
        """Check the frame accounting against the queues.

        Skip it while a stage is processing a frame: its count is in transit.
        """
        with self.worker.lock, self._stages[-1].lock:
            if not any(stage.busy for stage in self._stages):
                kept = [self.open_frame(), *(stage.waiting for stage in self._stages)]
                self.diagnostics.audit(*map(sum, zip(*kept)))

    def subscribe(self, topic: str, handle: Callable[[bytes], None],
                  count: Callable[[bytes], int] = lambda raw: 0) -> None:
        """Have the worker call `handle` with the CDR bytes of the frames on one of the spec's inputs.

        Args:
            count: photons that a message announces, called in the executor's thread.
        """
        def work(raw: bytes, sent_ns: int) -> None:
            if 0 < self._valid_from_ns - sent_ns < OUTDATED_NS:
                raise Dropped("outdated", "it was sent before the description in force")
            handle(raw)

        def received(raw: bytes, info: dict) -> None:
            photons = count(raw)
            with self.worker.lock:
                self.diagnostics.received(photons)
                self.worker.offer(work, raw, info["source_timestamp"], photons=photons)

        queued = QUEUE_DEPTH if self.lossless else self.queue_depth
        depth = SUBSCRIBE_DEPTH * self.worker.messages_per_frame if self.worker.limit == NEWEST_ONLY else queued
        depth = min(depth, QUEUE_DEPTH)
        subscription = self.listen_counting(topic, received, depth, self.diagnostics.lost)
        self.diagnostics.expect(subscription.topic_name, self.spec.topic(topic).type_name)

    def listen_counting(self, topic: str, handle: Callable[[bytes, dict], None], depth: int,
                        lost: Callable[[int], None]) -> Subscription:
        """As `listen`, with what the middleware knows of a message; `lost` is told how many never came out of it."""
        gaps = SequenceLoss(lambda: subscription.get_publisher_count())

        def received(raw: bytes, info: dict) -> None:
            lost(gaps.after(info["publication_sequence_number"]))
            handle(raw, info)

        def told(event) -> None:
            if not gaps.numbered:       # or they would be counted twice
                lost(event.total_count_change)

        subscription = self._listen(topic, received, depth, raw=True, lost=told)
        return subscription

    def follow(self, topic: str, handle: Callable[[object], None], qos: QoSProfile | None = None) -> None:
        """Have the worker call `handle` with the messages on an input that describes or reports; none is dropped.

        Args:
            qos: other than the topic's own; the user may override both.
        """
        def work(message, sent_ns: int) -> None:
            self._followed_ns = sent_ns
            try:
                handle(message)
            except InvalidInput as problem:
                if self._held_for:
                    self.diagnostics.wait_for(f"{self._held_for} that can be used: {problem}")
                raise

        self._listen(topic, lambda message, info: self.worker.call(work, message, info["source_timestamp"]),
                     FOLLOW_DEPTH, qos=qos)

    def drop_older(self) -> None:
        """Called for a description that replaces another: drop the frames that its sender had sent before it."""
        self._valid_from_ns = self._followed_ns

    def listen(self, topic: str, handle: Callable[[bytes], None]) -> Subscription:
        """Have the executor call `handle` with the CDR bytes on an input; for what must not wait for the worker."""
        return self._listen(topic, handle, QUEUE_DEPTH, raw=True)

    def _listen(self, topic: str, callback: Callable, depth: int, raw: bool = False, lost=None,
                qos: QoSProfile | None = None) -> Subscription:
        declared = self.spec.topic(topic)
        # Not LATCHED: a queue of one would lose all but one of what several publishers keep for a late subscriber.
        durability = DurabilityPolicy.TRANSIENT_LOCAL if declared.latched else DurabilityPolicy.VOLATILE
        qos = qos or QoSProfile(depth=depth, durability=durability)
        options = {"raw": raw, "qos_overriding_options": OVERRIDABLE}
        events = SubscriptionEventCallbacks(message_lost=lost)
        make = partial(self._make, self.create_subscription, declared, callback, qos)
        try:
            subscription = make(**options, event_callbacks=events)
        except UnsupportedEventTypeError:       # a middleware that cannot tell
            subscription = make(**options)
        self._listening.append(subscription)
        return subscription

    def advertise(self, topic: str) -> Publisher:
        """A publisher of one of the spec's outputs."""
        declared = self.spec.topic(topic)
        depth = QUEUE_DEPTH if self.lossless else PUBLISH_DEPTH
        qos = LATCHED if declared.latched else QoSProfile(depth=depth)
        publisher = self._make(self.create_publisher, declared, qos, qos_overriding_options=OVERRIDABLE)
        self._advertised.append(publisher)
        return publisher

    def _make(self, create: Callable, declared: Topic, *args, **options):
        """A subscription or publisher. The middleware does not say why it has none: names are rclpy's to check."""
        try:
            return create(declared.type, declared.name, *args, **options)
        except UnsupportedEventTypeError:
            raise
        except rclpy_implementation.RCLError:
            raise InvalidInput(f"topic of {declared.name}", self.resolve_topic_name(declared.name),
                               f"one without another type than {declared.type_name} in this process") from None

    def serve(self, name: str, job: Callable[[], str]) -> None:
        """Serve `~/name` (std_srvs/Trigger) while active: the worker does the job; the answer is what it returns."""
        def work(answer: Future) -> None:
            try:
                node = self.get_fully_qualified_name()
                require(self.state == "active", node, self.state, f"an active node: ros2 lifecycle set {node} activate")
                answer.set_result((True, job()))
            except InvalidInput as error:
                answer.set_result((False, str(error)))
            except Exception as error:
                self._failed(error)
                answer.set_result((False, _in_words(error)))

        async def serve(_, response: Trigger.Response) -> Trigger.Response:
            answer = Future()
            self.worker.call(work, answer)
            response.success, response.message = await answer
            return response

        self._serving.append(self.create_service(Trigger, f"~/{name}", serve, callback_group=self._services_group))

    def hold_frames_for(self, what: str) -> None:
        """Say that no frame can be used before `what` has come; those that may queue wait until `release_frames`."""
        self._held_for = what
        self.diagnostics.wait_for(what)
        if self.worker.limit > NEWEST_ONLY:
            self.worker.hold_frames()

    def release_frames(self) -> None:
        """What frames were held for has come."""
        self._held_for = ""
        self.diagnostics.wait_for("")
        self.worker.release_frames()

    def publish_frame(self, publisher: Publisher, data: bytes, stamp_ns: int, **amounts: int) -> None:
        """Publish the CDR bytes of the frame acquired at `stamp_ns`; when lossless, wait for a subscriber first.

        Args:
            amounts: totals to which the frame adds.

        Raises:
            Dropped: the node was stopped before a subscriber came.
        """
        if self.lossless and not self.wait_until(publisher.get_subscription_count,
                                                 f"a subscriber on {publisher.topic_name}"):
            raise Dropped(self._stopped_for, f"nobody had subscribed to {publisher.topic_name}")
        publisher.publish(data)
        self.sent(stamp_ns, **amounts)

    def sent(self, stamp_ns: int, **amounts: int) -> None:
        """A frame acquired at `stamp_ns` has left this node, now; `amounts` are totals to which it adds."""
        self.diagnostics.sent((self.now_ns() - stamp_ns) * 1e-9, **amounts)

    def now_ns(self) -> int:
        """Nanoseconds of the node's clock, which may be a simulated one."""
        return self.get_clock().now().nanoseconds

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float = float("inf")) -> bool:
        """Wait, in the worker thread, for a condition; say so if it takes long. False if it never held."""
        started, told = time.monotonic(), False
        while not (met := condition()) and not self.halted.wait(POLL_S):
            waited_s = time.monotonic() - started
            if waited_s >= timeout_s:
                break
            if waited_s >= TELL_AFTER_S and not told:
                told = True
                self.diagnostics.wait_for(what)
                self.get_logger().info(f"waiting for {what}")
        if told:
            self.diagnostics.wait_for("")
        return met

    def on_activate(self, state):
        """`ros2 lifecycle set … activate`: the worker may wait again."""
        self.halted.clear()
        return super().on_activate(state)

    def deactivate(self) -> None:
        """Take no more frames, finish the one in hand (those that wait are dropped, unless the node drains), forget."""
        self.stop_frames("inactive")
        self.diagnostics.wait_for("")

    def stop_frames(self, cause: str) -> None:
        """Unsubscribe and empty the queue: what waits is dropped for `cause` or, if the node drains, worked on."""
        self.unsubscribe()
        self._stopped_for = cause
        self.halted.set()
        if not self.drains:
            self.worker.clear(cause)
        self.worker.release_frames()
        for stage in self._stages:
            stage.finish(self.finish_s)
        if self.state == "active":
            self.worker.call(self.forget)
            self.worker.finish(self.finish_s)

    def unsubscribe(self) -> None:
        """Take no more messages."""
        self.diagnostics.expect_nothing()
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        self._listening.clear()

    def cleanup(self) -> None:
        """Take back what `configure` advertised and served."""
        for publisher in self._advertised:
            self.destroy_publisher(publisher)
        for service in self._serving:
            self.destroy_service(service)
        self._advertised.clear()
        self._serving.clear()

    def refused(self, problem: Exception) -> None:
        """A transition failed: say why, the service's answer cannot."""
        self._failed(problem)

    def close(self) -> None:
        """Stop in order: finish the frame in hand, publish the last diagnostics, leave the graph."""
        if self.state in ("inactive", "active") and not (self._starting or self.finished.is_set()):
            self.get_logger().info("shutting down")     # else it has been, never started, or has said why it ends
        self.stop_frames("shutdown")
        for stage in self._stages:
            stage.close(self.finish_s)
        self.state = "finalized"
        self._audit()
        self.diagnostics.close()
        self._relay.close()
        self.destroy_node()

    def _failed(self, error: Exception, frames: int = 0, photons: int = 0) -> None:
        """Something failed, and so many frames with it."""
        if isinstance(error, Dropped):
            self.diagnostics.drop(error.cause, frames, photons)
            self.get_logger().warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
            return
        bad_input, text = isinstance(error, InvalidInput), _in_words(error)
        if frames:
            self.diagnostics.drop("malformed" if bad_input else "error", frames, photons)
        if frames and bad_input:
            self.diagnostics.note(text)
            self.get_logger().warning(f"frame dropped: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self.diagnostics.error(text)
            self.get_logger().error(text, throttle_duration_sec=LOG_EVERY_S)


def _in_words(error: Exception) -> str:
    """An exception in one line."""
    return str(error) if isinstance(error, InvalidInput) else f"{type(error).__name__}: {' '.join(str(error).split())}"
