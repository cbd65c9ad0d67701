"""The player alone: what it sends, when, and how it ends."""

from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets.bags.writer import BagWriter, Offer
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file,
                                                                          tmp_path):
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor.replace(frame_id="mast")))
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5,
                         sensor_file=tmp_path / "sensor.json")
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


def test_a_bag_is_sent_as_it_was_recorded(graph, tmp_path, descriptions, recorded):
    bag = write_bag(tmp_path / "bag", [descriptions[0], *recorded, descriptions[1]])
    player, described = start_player(graph, input=bag)
    frames = graph.collect(PointCloud2, "photons", raw=True)
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 4 and len(described) == 2, "what is in the bag")
    assert [frame[:len(raw)] for frame, raw in zip(frames, recorded)] == recorded
    assert [sensor_message.decode(message).num_bins for message in described] == [100, 90]
    report = graph.reports("player", "frames_sent", 4)
    assert 5 <= float(report["latency_p50_ms"]) < 1000      # by the recording's clock, 50 years later by the node's


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
