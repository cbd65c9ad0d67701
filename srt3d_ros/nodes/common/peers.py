"""Peers: the nodes that send frames to a node and read its frames, as the middleware shows them."""

from collections.abc import Iterable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import get_rmw_implementation_identifier

DOUBLE_S = 25.0         # before a warning of a second node or publisher: a killed one stays in the graph for 20 s


class Peers:
    """The publishers and readers of a node's topics, which are given by their final names."""

    def __init__(self, node: Node):
        self._node = node
        self._since: dict[object, float] = {}       # when each publisher and each node of this name was first seen

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

    def doubled(self, topics: Iterable[str], now_s: float) -> str:
        """A warning if two nodes of this name, or two publishers on a topic, have been there for DOUBLE_S together."""
        node, name = self._node, self._node.get_fully_qualified_name()
        namesakes = node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace()))
        present = {f"nodes are named {name}": [(name, number) for number in range(namesakes)]}
        present |= {f"publishers send frames on {topic}": [bytes(one.endpoint_gid) for one in self.publishers([topic])]
                    for topic in topics}
        self._since = {one: self._since.get(one, now_s) for ones in present.values() for one in ones}
        lasting = {words: sum(now_s - self._since[one] >= DOUBLE_S for one in ones) for words, ones in present.items()}
        doubled = " and ".join(f"{number} {words}" for words, number in lasting.items() if number > 1)
        return doubled and f"{doubled}: frames may come twice"


def names(endpoints: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    """Full names of the nodes of these endpoints, without the leading slash."""
    return tuple(sorted({f"{one.node_namespace}/{one.node_name}".lstrip("/") for one in endpoints}))


def all_acknowledged(publisher: Publisher) -> bool:
    """Whether every reliable subscriber has acknowledged all messages. Poll it: rclpy's own wait holds the GIL."""
    return publisher.wait_for_all_acked(Duration(seconds=0))


def unacknowledged_by() -> str:
    """The middleware if it always says that all messages are acknowledged, which means nothing; else an empty text."""
    name = get_rmw_implementation_identifier()
    return name if name == "rmw_zenoh_cpp" else ""
