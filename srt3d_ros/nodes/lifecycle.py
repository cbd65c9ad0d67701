"""A node from its start to its end: the transitions of a ROS 2 managed node, and the process that runs it."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.topics import OVERRIDABLE, NodeSpec, Topic
from srt3d_ros.processes import transport

PUBLISH_DEPTH = 8       # messages of 10 ms for as long as a thread may wait for the processor
WAKE_S = 0.1            # longest time until a signal is seen
RETRY_S = 0.01          # after a callback that failed, as it may again and again
BAD_INPUT = 2
LIBRARY = logging.getLogger("srt3d_ros")


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
        """Undo `configure`: destroy the publishers."""
        for publisher in self.publishers_made:
            self.destroy_publisher(publisher)
        self.publishers_made.clear()

    def failed(self, error: Exception) -> None:
        """Log why a callback failed, or a transition that a manager asked for, whose reply has no field for it."""

    def set_parameters_atomically(self, parameter_list) -> SetParametersResult:
        """As of rclpy, which lets the exception for a parameter that does not exist end the process."""
        try:
            return super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

    # ---- Topics of the spec

    def advertise(self, topic: str) -> Publisher:
        """A publisher of one of the spec's outputs, until `cleanup`; of a latched one, the last message stays."""
        declared = self.spec.topic(topic)
        qos = QoSProfile(depth=1 if declared.latched else PUBLISH_DEPTH, durability=declared.durability)
        self.publishers_made.append(self._make(self.create_publisher, declared, qos))
        return self.publishers_made[-1]

    def make_subscription(self, topic: str, callback: Callable, depth: int, raw: bool = False,
                          reliability: ReliabilityPolicy = ReliabilityPolicy.BEST_AVAILABLE) -> None:
        """Subscribe to one of the spec's inputs, until `unsubscribe`, as reliably as all its publishers send.

        BEST_AVAILABLE takes the reliability of the publishers that are there. For one of best effort that comes later,
        the subscription is made anew, unless the user's `qos_overrides` say otherwise.
        """
        declared, name = self.spec.topic(topic), self.resolve_topic_name(topic)

        def on_incompatible(event) -> None:
            policy = QoSPolicyKind(event.last_policy_kind)
            in_force = self.get_parameter(f"qos_overrides.{name}.subscription.reliability").value
            if policy == QoSPolicyKind.RELIABILITY and in_force == "best_available":
                if made in self.subscriptions_made:
                    self.subscriptions_made.remove(made)
                    self.destroy_subscription(made)
                    self.make_subscription(topic, callback, depth, raw, reliability)
                return
            self.get_logger().warning(f"New publisher discovered on topic '{name}', offering incompatible QoS. No "
                                      f"messages will be received from it. Last incompatible policy: {policy.name}")

        # Not a queue of one: it would lose all but one of what several publishers keep for a late subscriber.
        qos = QoSProfile(depth=depth, durability=declared.durability, reliability=reliability)
        events = SubscriptionEventCallbacks(incompatible_qos=on_incompatible)
        made = self._make(self.create_subscription, declared, callback, qos, raw=raw, event_callbacks=events)
        self.subscriptions_made.append(made)

    def unsubscribe(self) -> None:
        """Destroy the subscriptions; worker and executor may do so at the same time."""
        made, self.subscriptions_made = self.subscriptions_made, []
        for subscription in made:
            self.destroy_subscription(subscription)

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
        steps = [self.deactivate] * (self.state == "active") + [self.cleanup]
        return self._step(lambda: [step() for step in steps], "finalized", "finalized")

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
            try:
                step()
            except Exception:
                undo()
                raise
        except Exception as problem:
            self.problem = problem
            if not self._starting:
                self.failed(problem)
            return TransitionCallbackReturn.FAILURE
        self.state = state
        if not self._starting:
            self.get_logger().info(done)
        return TransitionCallbackReturn.SUCCESS


# ---- The process


class LogForwarding(logging.Handler):
    """Forwards what the library logs to a node's logger, and so to /rosout."""

    def __init__(self, logger):
        super().__init__(logging.INFO)
        self._logger = logger
        LIBRARY.setLevel(logging.INFO)
        LIBRARY.addHandler(self)        # for good: the process is the node's

    def emit(self, record: logging.LogRecord) -> None:
        """Log it; rclpy wants each severity to come from a source line of its own."""
        if record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def run(node_class: type[ManagedNode]) -> int:
    """Make the node, start it unless `autostart` is false, spin it until it is done or a signal comes, close it.

    A signal ends the process at once while the node starts, as the caller has it, and in order from then on: rclpy's
    own handlers would invalidate the context while the node finishes its frames and its recording. Whatever a callback
    raises is counted and logged, and the node goes on.

    Returns:
        The node's exit code, 0 unless it failed, also after SIGINT and SIGTERM; 2 with one line on stderr if a
        parameter, an argument or an input file cannot be used.
    """
    os.nice(node_class.niceness)        # before there are other threads, which inherit it
    transport.prepare_process()
    node, stop = None, threading.Event()
    try:
        node = _make(node_class)
        LogForwarding(node.get_logger())
        _start(node, stop.set)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (stop.is_set() or node.finished.is_set()):
            try:
                executor.spin_once(timeout_sec=WAKE_S)
            except rclpy_implementation.InvalidHandle:
                continue    # the worker destroyed a subscription whose events rclpy was about to wait for
            except Exception as problem:
                if not rclpy.ok():
                    raise
                node.failed(problem)
                stop.wait(RETRY_S)
    except InvalidInput as error:
        print(f"srt3d: error: {error}", file=sys.stderr)
        return BAD_INPUT
    finally:
        if node is not None:
            node.close()
        rclpy.try_shutdown()
    return node.exit_code


def _make(node_class: type[ManagedNode]) -> ManagedNode:
    """The node, or InvalidInput with what ROS 2 says of the command line and of its surroundings."""
    given = " ".join(sys.argv[1:])
    try:
        unused = remove_ros_args(sys.argv)[1:]      # -p, say, without --ros-args before it
        require(not unused, "command line", given, "nothing but --ros-args and what follows it, such as --ros-args "
                f"-p name:=value; not {' '.join(unused)}")
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        return node_class()
    except RuntimeError as error:       # of rcl
        raise InvalidInput("command line", given, "arguments and surroundings with which ROS 2 starts a node "
                           f"({' '.join(str(error).split())})") from None


def _start(node: ManagedNode, on_signal: Callable[[], None]) -> None:
    """Configure and activate the node if `autostart` is true; from then on a signal calls `on_signal`."""
    said = "ready"
    if node.parameters["autostart"]:
        node.start()
    else:
        said = f"unconfigured, as autostart is false: ros2 lifecycle set {node.get_fully_qualified_name()} configure"
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: on_signal())
    node.get_logger().info(said)
    node.diagnostics.report()
