"""The nodes that send frames to a node and read its frames, as the middleware shows them.

Topics are given by their final names.
"""

from collections.abc import Iterable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo


def publishers(node: Node, topics: Iterable[str]) -> list[TopicEndpointInfo]:
    return [one for topic in topics for one in node.get_publishers_info_by_topic(topic)]


def readers(node: Node, topics: Iterable[str]) -> list[TopicEndpointInfo]:
    return [one for topic in topics for one in node.get_subscriptions_info_by_topic(topic)]


def in_words(node: Node, topics: Sequence[str]) -> str:
    """The topics, how many publishers they have, and why the QoS of some does not match that of the node."""
    *first, last = topics
    words = f"{', '.join(first)} or {last}" if first else last
    found, own = publishers(node, topics), node.get_fully_qualified_name().lstrip("/")
    asked = {one.topic_type: one.qos_profile for one in readers(node, topics) if names([one]) == (own,)}
    checks = [qos_check_compatible(one.qos_profile, asked.get(one.topic_type, one.qos_profile)) for one in found]
    reasons = {reason.removeprefix("ERROR: ").rstrip("; ") for outcome, reason in checks
               if outcome == QoSCompatibility.ERROR}
    mismatch = f", QoS does not match: {', '.join(reasons)}" if reasons else ""
    return f"{words} (publishers: {len(found)}{mismatch})"


def names(endpoints: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    """Full names of the nodes of these endpoints, without the leading slash."""
    return tuple(sorted({f"{one.node_namespace}/{one.node_name}".lstrip("/") for one in endpoints}))


def all_acknowledged(publisher: Publisher) -> bool:
    """Whether every reliable subscriber has acknowledged all messages. Poll it: rclpy's own wait holds the GIL."""
    return publisher.wait_for_all_acked(Duration(seconds=0))
