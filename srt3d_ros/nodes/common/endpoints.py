"""Endpoints: the publishers and subscriptions of a node, with the QoS of their topics."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.common.rclpy_patches import RCLError
from srt3d_ros.nodes.common.topics import OVERRIDABLE, Topic

PUBLISH_DEPTH = 8       # at 100 Hz, a subscriber may be kept from the CPU for 80 ms
BEST_AVAILABLE = ReliabilityPolicy.BEST_AVAILABLE


class Endpoints:
    """Makes the publishers and subscriptions of a node, and destroys them."""

    def __init__(self, node: Node):
        self._node = node
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []

    def advertise(self, topic: Topic) -> Publisher:
        """Create the publisher of a topic; `close` destroys it."""
        qos = QoSProfile(depth=1 if topic.latched else PUBLISH_DEPTH, durability=topic.durability)
        made = self._make(self._node.create_publisher, topic, qos)
        self._publishers.append(made)
        return made

    def subscribe(self, topic: Topic, callback: Callable[[bytes, dict], None], depth: int,
                  reliability: ReliabilityPolicy = BEST_AVAILABLE) -> None:
        """Call `callback` with the bytes of each message and its info until `unsubscribe`.

        BEST_AVAILABLE adopts the reliability of the present publishers. When a best-effort publisher appears later,
        the subscription is created again, unless the user's `qos_overrides` prevent it.
        """
        name = self._node.resolve_topic_name(topic.name)

        def on_incompatible(event: Any) -> None:
            policy = QoSPolicyKind(event.last_policy_kind)
            in_force = self._node.get_parameter(f"qos_overrides.{name}.subscription.reliability").value
            if policy != QoSPolicyKind.RELIABILITY or in_force != "best_available":
                self._node.get_logger().warning(
                    f"New publisher discovered on topic '{name}', offering incompatible QoS. No messages will be "
                    f"received from it. Last incompatible policy: {policy.name}")
            elif made in self._subscriptions:
                self._subscriptions.remove(made)
                self._node.destroy_subscription(made)
                self.subscribe(topic, callback, depth, reliability)

        # A queue of one would lose latched messages of several publishers.
        qos = QoSProfile(depth=depth, durability=topic.durability, reliability=reliability)
        events = SubscriptionEventCallbacks(incompatible_qos=on_incompatible)
        made = self._make(self._node.create_subscription, topic, callback, qos, raw=True, event_callbacks=events)
        self._subscriptions.append(made)

    def unsubscribe(self) -> None:
        """Destroy the subscriptions; the worker and the executor may call this at the same time."""
        made, self._subscriptions = self._subscriptions, []
        for subscription in made:
            self._node.destroy_subscription(subscription)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def _make(self, create: Callable[..., Any], topic: Topic, *args: object, **options: object) -> Any:
        """Create a subscription or publisher; InvalidInput if the user's names or `qos_overrides` prevent it."""
        try:
            return create(topic.load(), topic.name, *args, qos_overriding_options=OVERRIDABLE, **options)
        except RCLError:        # rclpy has checked the name, and the middleware does not say why it fails
            problem = (f"Cannot use {self._node.resolve_topic_name(topic.name)} as {topic.name}: the node already uses "
                       f"it with another type than {topic.type}.")
        except Exception as error:      # a bag's name that ROS 2 refuses, or a value in qos_overrides
            problem = f"Cannot use {topic.name}: {str(error).partition(chr(10))[0]}"
        raise InvalidInput(topic.name, problem=problem)


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
