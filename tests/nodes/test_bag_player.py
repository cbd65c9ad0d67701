"""`srt3d play BAG`, as a process of its own: what it publishes, and from which topics."""

import signal
import sys
from dataclasses import replace
from itertools import cycle, islice

import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.datasets.bags.bag import Bag
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photons_message, sensor_message
from srt3d_ros.nodes.bag_player import topics_to_play
from tests.bags import CLOUD, IMAGE, TEXT, write_bag
from tools.processes import Process

ODOMETRY = "nav_msgs/msg/Odometry"
STAMPS_NS = [1_000_000_000 + 50_000_000 * k for k in range(3)]


@pytest.fixture
def play(graph):
    """Plays a bag in the graph's namespace, with these options."""
    def start(bag, *options: str) -> Process:
        command = [sys.executable, "-m", "srt3d_ros.cli.main", "play", str(bag), "--namespace", graph.namespace]
        graph.processes.append(Process([*command, *options]))
        return graph.processes[-1]

    return start


def test_a_bag_is_played_as_it_was_recorded_once_or_in_a_loop(graph, play, sensor, events, tmp_path):
    frames = [photons_message.encode_cdr(replace(events, stamp_ns=stamp_ns), sensor, "spad") for stamp_ns in STAMPS_NS]
    pose = serialize_message(Odometry())
    bag = write_bag(tmp_path / "bag", [
        ("/sensor", TEXT, sensor_message.encode_cdr(sensor)), ("/photons", CLOUD, frames[0], 10),
        ("/odom", ODOMETRY, pose, 20), ("/points", CLOUD, b"", 30),
        *(("/photons", CLOUD, raw, 60 + 50 * k) for k, raw in enumerate(frames[1:]))])
    poses, photons = graph.collect(Odometry, "odom", raw=True), graph.collect(PointCloud2, "photons", raw=True)
    player = play(bag, "--rate", "0.5")
    assert player.code() == 0 and "played bag to its end" in player.text
    graph.wait(lambda: len(photons) == 3 and poses, "all messages")
    whole = len(frames[0])      # the middleware may pad messages
    assert [raw[:whole] for raw in photons] == frames and poses[0].startswith(pose)

    described, sketches = graph.collect_latched(String, "sensor"), graph.collect(PointCloud2, "sketch")
    graph.start("sketcher")
    player = play(bag, "--loop")
    graph.wait(lambda: sketches and len(photons) > 8, "sketches of a bag that is played again and again")
    again = [raw[:whole] for raw in photons[3:]]
    first = frames.index(again[0])      # the player begins with its first subscriber, which may be the sketcher
    assert again == list(islice(cycle(frames), first, first + len(again)))
    assert sensor_message.from_json(described[0].data).same_as(sensor)
    assert sketches[0].header.stamp.sec * 10**9 + sketches[0].header.stamp.nanosec in STAMPS_NS
    player.send(signal.SIGINT)
    assert player.code() == 0


@pytest.mark.parametrize("topics, played", [
    ({"/photons": CLOUD, "/sensor": TEXT, "/sketch": CLOUD, "/sketch/sensor": TEXT, "/points": CLOUD, "/depth": IMAGE},
     ["/photons", "/sensor"]),
    ({"/a/gates": IMAGE, "/b/histograms": IMAGE, "/a/odom": ODOMETRY, "/a/imu": "sensor_msgs/msg/Imu", "/x/odom": TEXT},
     ["/a/gates", "/b/histograms", "/a/odom", "/a/imu"]),
    ({"/sketch": CLOUD, "/sketch/sensor": TEXT}, ["/sketch", "/sketch/sensor"]),
    ({"/sensor": TEXT, "/my photons": CLOUD, "/photons": TEXT}, None)])
def test_topics_of_this_package_are_played_and_sketches_only_without_photons(tmp_path, topics, played):
    with Bag(write_bag(tmp_path / "bag", [(name, kind, b"\0\1\0\0") for name, kind in topics.items()])) as bag:
        if played is None:
            with pytest.raises(InvalidInput, match="no topic named photons, gates, histograms, sketch. It has /"):
                topics_to_play(bag)
        else:
            assert {topic.name for topic in topics_to_play(bag)} == set(played)


def test_a_name_that_ros_refuses_is_one_line(play, tmp_path):
    player = play(write_bag(tmp_path / "bag", [(f"/{'a' * 300}/photons", CLOUD, b"\0\1\0\0")]))
    assert player.code() == 2 and player.text.startswith("srt3d: error: Cannot publish /aaa")
