"""Peers: the nodes that send frames to a node and read its frames, as the middleware shows them."""

from collections.abc import Iterable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo


class Peers:
    """The publishers and readers of a node's topics, which are given by their final names."""

    def __init__(self, node: Node):
        self._node = node

    def publishers(self, topics: Iterable[str]) -> list[TopicEndpointInfo]:
        return [one for topic in topics for one in self._node.get_publishers_info_by_topic(topic)]

    def readers(self, topics: Iterable[str]) -> list[TopicEndpointInfo]:
        return [one for topic in topics for one in self._node.get_subscriptions_info_by_topic(topic)]

    def on(self, topics: Sequence[str]) -> str:
        """The topics in words, how many publishers they have, and why the QoS of some does not match."""
        *first, last = topics
        words = f"{', '.join(first)} or {last}" if first else last
        publishers, own = self.publishers(topics), self._node.get_fully_qualified_name().lstrip("/")
        asked = {one.topic_type: one.qos_profile for one in self.readers(topics) if names([one]) == (own,)}
        found = [qos_check_compatible(one.qos_profile, asked.get(one.topic_type, one.qos_profile))
                 for one in publishers]
        reasons = {reason.removeprefix("ERROR: ").rstrip("; ") for outcome, reason in found
                   if outcome == QoSCompatibility.ERROR}
        mismatch = f", QoS does not match: {', '.join(reasons)}" if reasons else ""
        return f"{words} (publishers: {len(publishers)}{mismatch})"


def names(endpoints: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    """Full names of the nodes of these endpoints, without the leading slash."""
    return tuple(sorted({f"{one.node_namespace}/{one.node_name}".lstrip("/") for one in endpoints}))


def all_acknowledged(publisher: Publisher) -> bool:
    """Whether every reliable subscriber has acknowledged all messages. Poll it: rclpy's own wait holds the GIL."""
    return publisher.wait_for_all_acked(Duration(seconds=0))
