"""The player alone: what it sends, when, and how it ends."""

import signal
from pathlib import Path

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.messages import cdr
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message


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


def test_lossless_keeps_at_most_in_flight_frames_unanswered(graph, photon_file):
    frames = graph.collect(PointCloud2, "photons")
    answers = graph.publisher(PointCloud2, "points")
    player = graph.start("player", input=photon_file, lossless=True, rate_hz=0, in_flight=2, frames=6)
    graph.matched(answers)
    for sent in (2, 3, 4, 5, 6):
        graph.wait(lambda: len(frames) == sent, f"frame {sent}")        # and not one more, or this would never hold
        answers.publish(PointCloud2(header=frames[sent - 2].header))
    assert player.running
    answers.publish(PointCloud2(header=frames[-1].header))
    assert player.code() == 0
    assert graph.report("player").get("unanswered") is None


RECORDED_NS, APART_NS = 1_600_000_000_000_000_000, 20_000_000


def write_bag(path: Path, messages: list[bytes]) -> Path:
    """A bag of photons, and of descriptions of their sensor where there is JSON, recorded 20 ms after each other."""
    writer = BagWriter(path)
    writer.add_topic("/spad/raw", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/spad/sensor", "std_msgs/msg/String", [Offer()])
    for k, raw in enumerate(messages):
        writer.write("/spad/sensor" if raw[8:9] == b"{" else "/spad/raw", RECORDED_NS + k * APART_NS, raw)
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


def test_another_sensor_comes_between_the_answered_frames_and_those_after_it(graph, tmp_path, descriptions, recorded):
    answers = graph.publisher(PointCloud2, "points")
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded[:2], descriptions[1], *recorded[2:]])
    player, described = start_player(graph, input=bag, lossless=True, bag_rate=0.0, in_flight=3)
    graph.matched(answers)
    frames = graph.collect(PointCloud2, "photons")
    graph.wait(lambda: len(frames) == 2, "the frames before it")
    answers.publish(frames[0])
    assert len(described) == 1
    answers.publish(frames[1])
    graph.wait(lambda: len(described) == 2 and len(frames) == 4, "the sensor and the frames after it")
    assert player.running
    answers.publish(frames[3])
    assert player.code() == 0


def test_activated_again_a_bag_is_played_from_its_beginning(graph, tmp_path, descriptions, recorded):
    def change(number: int) -> None:
        request = ChangeState.Request(transition=Transition(id=number))
        assert graph.call(ChangeState, "player/change_state", request).success

    answers = graph.publisher(PointCloud2, "points")
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded[:2], descriptions[1], *recorded[2:]])
    player, described = start_player(graph, input=bag, lossless=True, bag_rate=0.0, in_flight=1)
    graph.matched(answers)
    frames = graph.collect(PointCloud2, "photons", raw=True)
    for k in range(2):
        graph.wait(lambda: len(frames) == k + 1, "the frames before the other sensor")
        answers.publish(frames[k])
    graph.wait(lambda: len(frames) == 3 and len(described) == 2, "the other sensor and the first frame after it")
    change(Transition.TRANSITION_DEACTIVATE)
    change(Transition.TRANSITION_ACTIVATE)
    graph.wait(lambda: len(frames) == 4 and len(described) == 3, "the first sensor and the first frame")
    assert frames[3] == frames[0] and sensor_message.decode(described[2]).num_bins == 100
    assert player.running


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


def test_a_signal_while_it_waits_for_subscribers_ends_it_cleanly(graph, photon_file):
    player = graph.start("player", input=photon_file).says("waiting for 1 subscriber on ")
    assert graph.reports("player", "frames_out", 0)
    assert player.end(signal.SIGTERM) == 0
    assert "Traceback" not in player.text


def test_what_cannot_be_played_is_one_line_and_exit_code_2(graph):
    player = graph.start("player", clock=True)
    line = "clock is True: expected false, unless a bag keeps its stamps"
    assert (player.code(), player.lines) == (2, [line])
