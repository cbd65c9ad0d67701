"""ManagedNode: a ROS 2 lifecycle node; and `run`, the process that runs it."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import NameValidationException, ParameterNotDeclaredException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from srt3d_ros.errors import BAD_INPUT, InvalidInput, require
from srt3d_ros.nodes.common.topics import OVERRIDABLE, NodeSpec, Topic
from srt3d_ros.processes import transport

PUBLISH_DEPTH = 8       # at 100 Hz, a subscriber may be kept from the CPU for 80 ms
WAKE_S = 0.1            # longest time until a signal is noticed
RETRY_S = 0.01          # pause after a callback that failed: it may fail every time
LIBRARY = logging.getLogger("srt3d_ros")


class ManagedNode(LifecycleNode):
    """A lifecycle node with a method for each transition. If the method raises, the node keeps its state.

    The methods run in the executor's thread. `state` is the label that `ros2 lifecycle get` shows.
    """

    spec: NodeSpec

    def __init__(self, name: str, **options):
        super().__init__(name, **options)
        self.state = "unconfigured"
        self.problem: Exception | None = None       # why the last transition failed
        self.subscriptions_made: list[Subscription] = []
        self.publishers_made: list[Publisher] = []
        self._starting = False      # True in `start`, and after it has failed
        self._refuse_impossible_transitions()

    # ---- What a subclass overrides

    def configure(self) -> None:
        """Open files, compile kernels, create publishers."""

    def activate(self) -> None:
        """Subscribe and begin to work."""

    def deactivate(self) -> None:
        """Undo `activate`, also if it has failed halfway."""

    def cleanup(self) -> None:
        """Undo `configure`: destroy the publishers."""
        for publisher in self.publishers_made:
            self.destroy_publisher(publisher)
        self.publishers_made.clear()

    def failed(self, error: Exception) -> None:
        """Log why a callback or a requested transition failed; the reply to the request has no field for it."""

    def set_parameters_atomically(self, parameter_list) -> SetParametersResult:
        """As in rclpy, but a parameter that does not exist gives a failed result instead of an exception."""
        try:
            return super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

    # ---- Topics of the spec

    def advertise(self, topic: str) -> Publisher:
        """Create the publisher of one of the spec's outputs; `cleanup` destroys it."""
        declared = self.spec.topic(topic)
        qos = QoSProfile(depth=1 if declared.latched else PUBLISH_DEPTH, durability=declared.durability)
        self.publishers_made.append(self._make(self.create_publisher, declared, qos))
        return self.publishers_made[-1]

    def make_subscription(self, topic: str, callback: Callable, depth: int, raw: bool = False,
                          reliability: ReliabilityPolicy = ReliabilityPolicy.BEST_AVAILABLE) -> None:
        """Subscribe to one of the spec's inputs until `unsubscribe`.

        BEST_AVAILABLE adopts the reliability of the present publishers. When a best-effort publisher appears later,
        the subscription is created again, unless the user's `qos_overrides` prevent it.
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

        # A queue of one would lose latched messages of several publishers.
        qos = QoSProfile(depth=depth, durability=declared.durability, reliability=reliability)
        events = SubscriptionEventCallbacks(incompatible_qos=on_incompatible)
        made = self._make(self.create_subscription, declared, callback, qos, raw=raw, event_callbacks=events)
        self.subscriptions_made.append(made)

    def unsubscribe(self) -> None:
        """Destroy the subscriptions; the worker and the executor may call this at the same time."""
        made, self.subscriptions_made = self.subscriptions_made, []
        for subscription in made:
            self.destroy_subscription(subscription)

    def _make(self, create: Callable, topic: Topic, *args, **options):
        """Create a subscription or publisher; InvalidInput if the topic has another type in this process.

        The middleware does not say why it fails. Another type is the only cause left, as rclpy has checked the name.
        """
        try:
            return create(topic.load(), topic.name, *args, qos_overriding_options=OVERRIDABLE, **options)
        except NameValidationException as error:        # of a bag's topic
            raise InvalidInput(topic.name, problem=f"Cannot use {topic.name}: {str(error).splitlines()[0]}") from None
        except rclpy_implementation.RCLError:
            raise InvalidInput(topic.name, problem=f"Cannot use {self.resolve_topic_name(topic.name)} as {topic.name}: "
                               f"the node already uses it with another type than {topic.type}.") from None

    # ---- Transitions, as `ros2 lifecycle set` asks for them

    def start(self) -> None:
        """Configure and activate; raises the exception of a step that fails."""
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
        """End the node for good; its process waits for a signal."""
        def finalise() -> None:
            if self.state == "active":
                self.deactivate()
            self.cleanup()

        return self._step(finalise, "finalized", "finalized")

    def _refuse_impossible_transitions(self) -> None:
        """Answer impossible requests with a failure; rclpy 7.1 ends the process if one gives a transition's number."""
        change, machine = self._service_change_state.callback, self._state_machine
        labels = {number: label for number, label, *_ in machine.transition_graph}

        def guarded(request, response):
            asked = request.transition
            wanted, possible = asked.label or labels.get(asked.id, str(asked.id)), machine.available_transitions
            if any(wanted == label and (asked.label or asked.id == number) for number, label, *_ in possible):
                return change(request, response)
            self.get_logger().warning(f"no transition {wanted} while {self.state}")
            response.success = False
            return response

        self._service_change_state.callback = guarded

    def _step(self, step: Callable[[], None], state: str, done: str, undo: Callable[[], None] = lambda: None):
        """Run the method of a transition and set the state. Unless `start` runs it, log `done` or the failure."""
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
    """Forwards the library's log to a node's logger, and so to /rosout."""

    def __init__(self, logger):
        super().__init__(logging.INFO)
        self._logger = logger
        LIBRARY.setLevel(logging.INFO)
        LIBRARY.addHandler(self)        # never removed: the process has a single node

    def emit(self, record: logging.LogRecord) -> None:
        """Log a record. rclpy requires each severity to come from its own source line."""
        if record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def run(node_class: type[ManagedNode]) -> int:
    """Run a node in this process until it is finished or a signal arrives.

    While the node starts, signals act as the caller has set them. From then on, SIGINT and SIGTERM let it finish its
    frames and its recording; rclpy's own handlers would invalidate the context meanwhile. If a callback raises, the
    error is counted and logged, and the node goes on.

    Returns:
        The node's exit code: 0 unless it failed, also after SIGINT and SIGTERM; 2, with one line on stderr, if a
        parameter, an argument or an input file cannot be used.
    """
    os.nice(node_class.niceness)        # before there are other threads, which inherit it
    transport.prepare_process()
    node, stop = None, threading.Event()
    try:
        node = make_node(node_class)
        LogForwarding(node.get_logger())
        _start(node, stop.set)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (stop.is_set() or node.finished.is_set()):
            try:
                executor.spin_once(timeout_sec=WAKE_S)
            except rclpy_implementation.InvalidHandle:
                continue    # the worker destroyed a subscription that rclpy was about to wait for
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


def make_node(create: Callable[[], Node]) -> Node:
    """Start ROS 2 with `sys.argv` and create the node; InvalidInput if it rejects command line or environment."""
    try:
        unused = " ".join(remove_ros_args(sys.argv)[1:])
        require(not unused, "command line", problem=f"{unused}: put --ros-args before arguments for ROS 2, as in "
                "--ros-args -p name:=value.")
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        return create()
    except RuntimeError as error:       # of rcl
        raise InvalidInput("command line", problem=f"ROS 2 cannot start the node: {error}") from None


def _start(node: ManagedNode, on_signal: Callable[[], None]) -> None:
    """Configure and activate the node if `autostart` is true; from then on signals call `on_signal`."""
    outcome = "ready"
    if node.parameters["autostart"]:
        node.start()
    else:
        outcome = f"unconfigured, as autostart is false: ros2 lifecycle set {node.get_fully_qualified_name()} configure"
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: on_signal())
    node.get_logger().info(outcome)
    node.diagnostics.report()
