"""The player: what it sends, when, and how it ends; with `wait_for`, beside the nodes that it waits for."""

import signal
import sys
from itertools import cycle, islice

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import photon_frames, sensor_message
from tests.bags import CLOUD, START_NS, TEXT, write_bag
from tools.processes import Process

PLAYER = "from srt3d_ros.nodes import player; player"
STAMPS_NS = [1_000_000_000 + 50_000_000 * k for k in range(3)]


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file, tmp_path):
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor.replace(frame_id="mast")))
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5,
                         sensor_file=tmp_path / "sensor.json")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.from_json(described[0].data)
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photon_frames.PHOTONS.decode_cdr(serialize_message(frame), sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(np.array_equal(frame.toa, events.toa) for _, frame in decoded)
    assert graph.total("player", "first_stamp_ns") == stamps[0]
    assert graph.reports("player", "frames_out", 5)["dropped"] == "0"


def test_nodes_that_do_not_get_ready_are_named_and_no_frame_is_sent(graph, photon_file):
    frames = graph.collect(PointCloud2, "photons")      # another reader is none of those to wait for
    player = graph.start("player", code=f"{PLAYER}.READY_S = 0.5", input=photon_file, wait_for="sketcher", frames=1)
    assert player.code() == 2 and frames == []      # which `srt3d up` does not try again
    name = f"{graph.namespace}/sketcher"[1:]
    assert f"Nodes of wait_for were not ready within 0 s: {name} (no report on" in player.text


def test_a_frame_that_does_not_become_a_cloud_is_named_and_fails_the_run(graph, photon_file):
    player = graph.start("player", code=f"{PLAYER}.SETTLE_S = 2.0", input=photon_file, rate_hz=20.0, frames=4,
                         wait_for="sketcher reconstructor")
    player.says("waiting for")
    graph.start("reconstructor")
    graph.start("sketcher", packets_per_frame=3)
    assert player.code() == 3
    name = f"{graph.namespace}/sketcher"[1:]
    assert f"sent 4 ({name} 4, " in player.text and f"of which 1 were lost: 1 unfinished in {name}" in player.text


# ---- A bag

@pytest.fixture
def frames(photons_at) -> list[bytes]:
    return [photons_at(stamp_ns) for stamp_ns in STAMPS_NS]


def test_a_bag_is_played_as_it_was_recorded_and_becomes_sketches(graph, sensor, frames, tmp_path):
    pose = serialize_message(Odometry())
    bag = write_bag(tmp_path / "bag", [
        ("/sensor", TEXT, sensor_message.encode_cdr(sensor)), ("/photons", CLOUD, frames[0], 10),
        ("/odom", "nav_msgs/msg/Odometry", pose, 20), ("/points", CLOUD, b"", 30),
        *(("/photons", CLOUD, raw, 60 + 50 * k) for k, raw in enumerate(frames[1:]))])
    poses, photons = graph.collect(Odometry, "odom", raw=True), graph.collect(PointCloud2, "photons", raw=True)
    player = Process([sys.executable, "-m", "srt3d_ros.cli.main", "play", str(bag), "--rate", "0.5",
                      "--namespace", graph.namespace])
    graph.processes.append(player)
    assert player.code() == 0 and "sent all of" in player.text
    graph.wait(lambda: len(photons) == 3 and poses, "all messages")
    whole = len(frames[0])      # the middleware may pad messages
    assert [raw[:whole] for raw in photons] == frames and poses[0].startswith(pose)

    described, sketches = graph.collect_latched(String, "sensor"), graph.collect(PointCloud2, "sketch")
    graph.start("sketcher")
    player = graph.start("player", input=bag, loop=True)
    graph.wait(lambda: sketches and len(photons) > 8, "sketches of a bag that is played again and again")
    again = [raw[:whole] for raw in photons[3:]]
    first = frames.index(again[0])      # the player begins with its first subscriber, which may be the sketcher
    assert again == list(islice(cycle(frames), first, first + len(again)))
    assert sensor_message.from_json(described[0].data).same_as(sensor)
    assert sketches[0].header.stamp.sec * 10**9 + sketches[0].header.stamp.nanosec in STAMPS_NS
    player.send(signal.SIGINT)
    assert player.code() == 0


def test_remapped_photons_of_another_namespace_become_clouds_and_the_clock_is_the_bags(graph, sensor, frames, tmp_path):
    """The pipeline waits for the bag's description, and the player for the pipeline."""
    bag = write_bag(tmp_path / "bag", [
        ("/front/info", TEXT, sensor_message.encode_cdr(sensor), 0),
        *(("/front/raw", CLOUD, raw, 1000 + 50 * k) for k, raw in enumerate(frames))], "sqlite3")
    times = graph.collect(Clock, "/clock")
    graph.start("reconstructor")
    graph.start("sketcher")
    player = graph.start("player", "-r", "raw:=photons", "-r", "info:=sensor", input=bag, clock=40.0,
                         wait_for="sketcher reconstructor")
    assert player.code() == 0 and "sent 3, none lost" in player.text
    graph.wait(lambda: times, "/clock")
    passed_ms = [(one.clock.sec * 10**9 + one.clock.nanosec - START_NS) / 1e6 for one in times]
    assert passed_ms == sorted(passed_ms) and {ms % 25 for ms in passed_ms} == {0} and passed_ms[-1] == 1100


def test_a_name_that_ros_refuses_is_one_line(graph, tmp_path, frames):
    names = f"/{'a' * 300}/photons", "/b/photons"       # in two namespaces, which are kept
    player = graph.start("player", input=write_bag(tmp_path / "bag", [(name, CLOUD, frames[0]) for name in names]))
    assert player.code() == 2 and player.text.splitlines()[-1].startswith("srt3d: error: Cannot use aaa")
