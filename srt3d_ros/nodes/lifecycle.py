"""ManagedNode: the transitions of a ROS 2 managed node as plain methods that may raise, and its topics."""

from collections.abc import Callable

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.topics import OVERRIDABLE, NodeSpec, Topic

PUBLISH_DEPTH = 8       # messages of 10 ms for as long as a thread may wait for the processor


class ManagedNode(LifecycleNode):
    """A lifecycle node whose steps raise when they fail; the node then stays in its state.

    The steps run in the executor's thread. `state` is the label that `ros2 lifecycle get` shows.
    """

    spec: NodeSpec

    def __init__(self, name: str, **options):
        super().__init__(name, **options)
        self.state = "unconfigured"
        self.problem: Exception | None = None       # why the last transition failed
        self.subscriptions_made: list[Subscription] = []
        self.publishers_made: list[Publisher] = []
        self.services_made: list[Service] = []
        self._starting = False      # true in `start`, and after a `start` that failed
        self._refuse_impossible_transitions()

    # ---- What a subclass overrides

    def configure(self) -> None:
        """Open, compile, advertise."""

    def activate(self) -> None:
        """Subscribe and begin to work."""

    def deactivate(self) -> None:
        """Undo `activate`, or the part of it that succeeded."""

    def cleanup(self) -> None:
        """Undo `configure`: destroy the publishers and services."""
        for publisher in self.publishers_made:
            self.destroy_publisher(publisher)
        for service in self.services_made:
            self.destroy_service(service)
        self.publishers_made.clear()
        self.services_made.clear()

    def failed(self, error: Exception) -> None:
        """Log why a transition that a manager asked for failed. The service reply has no field for it."""

    # ---- Topics of the spec

    def advertise(self, topic: str, kept: int = 1) -> Publisher:
        """A publisher of one of the spec's outputs, until `cleanup`; of a latched one, `kept` messages stay."""
        declared = self.spec.topic(topic)
        qos = QoSProfile(depth=kept if declared.latched else PUBLISH_DEPTH, durability=declared.durability)
        self.publishers_made.append(self._make(self.create_publisher, declared, qos))
        return self.publishers_made[-1]

    def make_subscription(self, topic: str, callback: Callable, depth: int, qos: QoSProfile | None = None,
                          **options) -> Subscription:
        """A subscription to one of the spec's inputs, until `unsubscribe`."""
        declared = self.spec.topic(topic)
        # Not LATCHED: a queue of one would lose all but one of what several publishers keep for a late subscriber.
        qos = qos or QoSProfile(depth=depth, durability=declared.durability)
        self.subscriptions_made.append(self._make(self.create_subscription, declared, callback, qos, **options))
        return self.subscriptions_made[-1]

    def unsubscribe(self) -> None:
        """Destroy the subscriptions."""
        for subscription in self.subscriptions_made:
            self.destroy_subscription(subscription)
        self.subscriptions_made.clear()

    def _make(self, create: Callable, topic: Topic, *args, **options):
        """A subscription or publisher. The middleware gives no reason for a failure; rclpy has checked the name."""
        try:
            return create(topic.load(), topic.name, *args, qos_overriding_options=OVERRIDABLE, **options)
        except rclpy_implementation.RCLError:
            raise InvalidInput(f"topic of {topic.name}", self.resolve_topic_name(topic.name),
                               f"one without another type than {topic.type} in this process") from None

    # ---- Transitions, as `ros2 lifecycle set` asks for them

    def start(self) -> None:
        """Configure and activate; raises what they raise."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self.problem
        self._starting = False

    def on_configure(self, _) -> TransitionCallbackReturn:
        return self._step(self.configure, "inactive", "configured", self.cleanup)

    def on_activate(self, _) -> TransitionCallbackReturn:
        return self._step(self.activate, "active", "ready", self.deactivate)

    def on_deactivate(self, _) -> TransitionCallbackReturn:
        return self._step(self.deactivate, "inactive", "deactivated")

    def on_cleanup(self, _) -> TransitionCallbackReturn:
        return self._step(self.cleanup, "unconfigured", "cleaned up")

    def on_shutdown(self, _) -> TransitionCallbackReturn:
        """The node cannot be used again; its process ends with a signal."""
        if self.state == "active":
            self.deactivate()
        return self._step(self.cleanup, "finalized", "finalized")

    def _refuse_impossible_transitions(self) -> None:
        """Answer no. rclpy 7.1 lets its exception end the process where a transition is asked for by number."""
        change = self._service_change_state.callback

        def guarded(request, response):
            try:
                return change(request, response)
            except rclpy_implementation.RCLError:
                self.get_logger().warning(f"no transition {request.transition.id} while {self.state}")
                response.success = False
                return response

        self._service_change_state.callback = guarded

    def _step(self, step: Callable[[], None], state: str, done: str, undo: Callable[[], None] = lambda: None):
        """Take a step. `start` logs its end itself; a step that a manager asked for logs `done`."""
        try:
            step()
        except Exception as problem:
            self.problem = problem
            undo()
            if not self._starting:
                self.failed(problem)
            return TransitionCallbackReturn.FAILURE
        self.state = state
        if not self._starting:
            self.get_logger().info(done)
        return TransitionCallbackReturn.SUCCESS
