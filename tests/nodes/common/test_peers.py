"""The other nodes on a topic: how many send, whose QoS does not match, and what has been there twice for long."""

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from srt3d_ros.nodes.common.peers import DOUBLE_S, Peers, names
from tests.nodes.conftest import LATCHED


def test_publishers_are_counted_and_a_qos_that_does_not_match_is_named(graph):
    topic, peers = f"{graph.namespace}/sensor", Peers(graph.node)
    assert peers.on([topic, "/gates"]) == f"{topic} or /gates (publishers: 0)"
    graph.collect_latched(String, topic)
    graph.latched(topic)
    graph.wait(lambda: peers.on([topic]) == f"{topic} (publishers: 1)", "a latched publisher")
    graph.node.create_publisher(String, topic, QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE))
    graph.wait(lambda: peers.on([topic]) == f"{topic} (publishers: 2, QoS does not match: Volatile publisher and "
                                            "transient local subscription)", "another")
    name = f"{graph.namespace}/tester"[1:]
    assert names(peers.publishers([topic])) == names(peers.readers([topic])) == (name,)


def test_two_that_stay_are_a_warning_and_one_that_replaces_another_is_none(graph):
    topic, node = f"{graph.namespace}/photons", graph.node
    publishers, peers = [node.create_publisher(String, topic, LATCHED) for _ in range(2)], Peers(node)

    def doubled(now_s: float, number: int = 2) -> str:
        graph.wait(lambda: node.count_publishers(topic) == number, "the publishers")
        return peers.doubled([topic], now_s)

    assert doubled(0.0) == ""
    node.destroy_publisher(publishers.pop())
    assert doubled(20.0, number=1) == ""
    publishers.append(node.create_publisher(String, topic, LATCHED))
    assert doubled(21.0) == doubled(20.0 + DOUBLE_S) == ""
    warning = f"2 publishers send frames on {topic}"
    assert doubled(21.0 + DOUBLE_S) == f"{warning}: frames may come twice"
    namesake = Node("tester", namespace=graph.namespace)
    graph.wait(lambda: node.get_node_names().count("tester") == 2, "the other node")
    assert doubled(50.0) == f"{warning}: frames may come twice"
    both = f"2 nodes are named {graph.namespace}/tester and {warning}"
    assert doubled(50.0 + DOUBLE_S) == f"{both}: frames may come twice"
    namesake.destroy_node()
