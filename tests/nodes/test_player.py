"""The player alone: what it sends, when, and how it ends."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.messages import cdr
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes.moving_source import PACKETS, extrinsics


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file):
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5, frame_id="mast")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.decode(described[0])
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photons_message.decode_cdr(serialize_message(frame), sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(np.array_equal(frame.toa, events.toa) for _, frame in decoded)
    report = graph.reports("player", "frames_sent", 5)
    assert int(report["first_stamp_ns"]) == stamps[0] and int(report["photons_sent"]) == 5 * events.photons


HAS_TF = find_spec("tf2_msgs") is not None
RECORDED_NS, APART_NS = 1_600_000_000_000_000_000, 20_000_000


def write_bag(path: Path, messages: list[bytes], transforms: tuple[bytes, ...] = ()) -> Path:
    """A bag of photons, and of descriptions of their sensor where there is JSON, recorded 20 ms after each other."""
    writer = BagWriter(path)
    writer.add_topic("/spad/raw", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/spad/sensor", "std_msgs/msg/String", [Offer()])
    for k, raw in enumerate(messages):
        writer.write("/spad/sensor" if raw[8:9] == b"{" else "/spad/raw", RECORDED_NS + k * APART_NS, raw)
    if transforms:
        writer.add_topic("/tf_static", "tf2_msgs/msg/TFMessage", [Offer()])
    for raw in transforms:
        writer.write("/tf_static", RECORDED_NS, raw)
    writer.close()
    return path


@pytest.fixture
def descriptions(sensor) -> list[bytes]:
    return [sensor_message.encode_cdr(sensor.replace(num_bins=bins)) for bins in (100, 90)]


@pytest.fixture
def recorded(sensor) -> list[bytes]:
    """Four frames, stamped 5 or 3 ms before they were recorded if they are recorded from the second message on."""
    stamps = [RECORDED_NS + (k + 1) * APART_NS - delay_ms * 1_000_000 for k, delay_ms in enumerate((5, 3, 5, 5))]
    frames = [PhotonEvents(np.array([k], np.uint32), np.array([7], np.uint16), stamp) for k, stamp in enumerate(stamps)]
    return [photons_message.encode_cdr(frame, sensor, "spad") for frame in frames]


def start_player(graph, **parameters) -> tuple:
    """A player that waits for whoever subscribes to its photons, and the descriptions, of which the first has come."""
    described = graph.collect_latched(String, "sensor")
    player = graph.start("player", **parameters)
    graph.wait(lambda: described, "the first description")
    return player, described


def test_a_bag_is_sent_as_it_was_recorded_with_its_clock(graph, tmp_path, descriptions, recorded):
    clocks = graph.collect(Clock, "/clock")
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded, descriptions[1]])
    player, described = start_player(graph, input=bag, clock=True)
    graph.wait(lambda: clocks, "a clock that begins before the frames")
    frames = graph.collect(PointCloud2, "photons", raw=True)
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 4 and len(described) == 2, "what is in the bag")
    assert [frame[:len(raw)] for frame, raw in zip(frames, recorded)] == recorded
    assert [sensor_message.decode(message).num_bins for message in described] == [100, 90]
    times = [clock.clock.sec * 10**9 + clock.clock.nanosec for clock in clocks]
    assert times == sorted(times) and RECORDED_NS <= times[0] < times[-1] <= RECORDED_NS + 5 * APART_NS
    report = graph.reports("player", "frames_sent", 4)
    assert report["latency_p50_ms"] == "5.00"       # by the recording's clock


def test_a_bag_can_be_stamped_as_if_it_happened_now(graph, tmp_path, descriptions, recorded):
    frames, before_ns = graph.collect(PointCloud2, "photons", raw=True), graph.node.get_clock().now().nanoseconds
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded])
    assert graph.start("player", input=bag, bag_stamps="now", bag_rate=4.0).code() == 0
    graph.wait(lambda: len(frames) == 4, "what is in the bag")
    stamps = [cdr.stamp_ns(frame) for frame in frames]
    assert np.diff(stamps).tolist() == [5_500_000, 4_500_000, 5_000_000] and stamps[0] > before_ns
    assert [frame[12:len(raw)] for frame, raw in zip(frames, recorded)] == [raw[12:] for raw in recorded]


@pytest.mark.skipif(HAS_TF, reason="tf2_msgs is installed, and /tf_static is played")
def test_without_tf2_msgs_a_line_says_that_tf_static_is_not_played(graph, tmp_path, descriptions, recorded):
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded], (bytes(8),))
    player = graph.start("player", input=bag, wait_for_subscribers=0)
    assert player.code() == 0
    assert "/tf_static in the bag is not played, for tf2_msgs is not installed" in player.text


@pytest.mark.skipif(not HAS_TF, reason="tf2_msgs is not installed")
def test_tf_static_of_a_bag_is_latched_whoever_published_it(graph, tmp_path, descriptions, recorded):
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    messages = [TFMessage(transforms=[TransformStamped(child_frame_id=name)]) for name in ("mast", "spad")]
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded], (*map(serialize_message, messages),) * 2)
    start_player(graph, input=bag)
    came: list = []
    graph.node.create_subscription(TFMessage, "/tf_static", came.append, QoSProfile(
        depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    graph.wait(lambda: len(came) > 1, "both")
    assert came == messages


def test_lossless_play_waits_for_answers_and_begins_again_where_it_is_activated_again(graph, tmp_path, descriptions,
                                                                                      recorded):
    """No frame is unanswered when another sensor is described."""
    answers = graph.publisher(PointCloud2, "points")
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded[:3], descriptions[1], recorded[3]])
    player, described = start_player(graph, input=bag, lossless=True, bag_rate=0.0, in_flight=2)
    graph.matched(answers)
    frames = graph.collect(PointCloud2, "photons", raw=True)

    def play_through(first: int, descriptions: int) -> None:
        graph.wait(lambda: len(frames) >= first + 2, "two frames")
        answers.publish(frames[first])
        graph.wait(lambda: (len(frames) - first, len(described)) == (3, descriptions), "a third, and not one more")
        answers.publish(frames[first + 1])
        answers.publish(frames[first + 2])
        graph.wait(lambda: (len(frames) - first, len(described)) == (4, descriptions + 1), "the last one")

    play_through(0, 1)
    assert graph.change("player", "deactivate") and graph.change("player", "activate")
    play_through(4, 3)
    assert [sensor_message.decode(message).num_bins for message in described] == [100, 90, 100, 90]
    assert frames[:4] == frames[4:] and player.running
    answers.publish(frames[-1])
    assert player.code() == 0 and graph.report("player").get("unanswered") is None


def test_frames_of_several_messages_are_known_by_their_answers_also_the_last_and_one_without_end(
        graph, tmp_path, descriptions, sensor):
    """Three messages a frame, and a cloud has the stamp of the first, as the sketcher's default is."""
    answers = graph.publisher(PointCloud2, "points")
    stamps = [RECORDED_NS + k * APART_NS for k in range(10)]
    packets = [photons_message.encode_cdr(PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16), stamp_ns),
                                          sensor, "spad") for stamp_ns in stamps]
    bag = write_bag(tmp_path / "bag", [descriptions[0], *packets])
    player, _ = start_player(graph, input=bag, lossless=True, bag_rate=0.0, in_flight=2)
    graph.matched(answers)
    sent = graph.collect(PointCloud2, "photons", raw=True)
    for first in (0, 3, 6):
        graph.wait(lambda: len(sent) >= first + 3, "a whole frame")
        answers.publish(sent[first])
    assert player.code() == 0 and len(sent) == 10
    assert graph.report("player").get("unanswered") is None and "never answered" not in player.text


def test_lossless_play_loses_nothing_to_a_sketcher_that_waits_for_odometry(graph):
    graph.start("reconstructor", lossless=True).ready()
    graph.start("sketcher", packets_per_frame=PACKETS, motion="odom", extrinsics=extrinsics(),
                lossless=True).ready()
    # Later than motion_timeout_s: a live sensor's frames would go on without.
    player = graph.start("player", motion="walk", frames=3, ppp=2.0, lossless=True, odom_delay_s=0.15)
    assert player.code() == 0
    graph.reports("sketcher", "frames_deskewed", 3)
    assert graph.report("player").get("unanswered") is None and "never answered" not in player.text


def test_a_bag_that_breaks_off_is_one_line_and_exit_code_1(graph, tmp_path, descriptions, sensor):
    many = PhotonEvents(np.zeros(200_000, np.uint32), np.zeros(200_000, np.uint16), RECORDED_NS)
    large = photons_message.encode_cdr(many, sensor, "spad")        # each a chunk of its own
    file = write_bag(tmp_path / "bag", [descriptions[0], large, large, large]) / "bag.mcap"
    content = bytearray(file.read_bytes())
    third = content.rindex(large[:100])
    content[third - 30:third - 22] = (2**40).to_bytes(8, "little")      # the length of its record
    file.write_bytes(content)
    player, _ = start_player(graph, input=file)
    graph.wait(lambda: graph.report("player"), "a report")      # so that the last one will be heard, too
    graph.collect(PointCloud2, "photons", raw=True)
    assert player.code() == 1
    assert player.text.count("ERROR") == 1 and "bag bag.mcap is unreadable (Truncated record" in player.text
    assert "Traceback" not in player.text and graph.reports("player", "errors", 1)


def test_what_cannot_be_played_is_one_line_and_exit_code_2(graph):
    player = graph.start("player", clock=True)
    line = "clock is True: expected false, unless a bag keeps its stamps"
    assert (player.code(), player.lines) == (2, [line])
