"""What the player plays, message by message: what is due when, with which stamps, and where it begins and ends."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time

from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.core.sketching.sketch import noise_sketch
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photons
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes import player
from srt3d_ros.nodes.motion_input import parse_extrinsics
from srt3d_ros.nodes.sources import BEFORE_S, PACKETS, MovingSource, open_source
from tests.bags import CLOUD, MS, START_NS, TEXT, write_bag

BEFORE_NS, ODOMETRY = round(BEFORE_S * 1e9), "nav_msgs/msg/Odometry"
DEFAULTS = {parameter.name: parameter.default for parameter in player.PARAMETERS}


@pytest.fixture
def source():
    """Open the source that these parameters describe; closed after the test."""
    opened = []

    def open_with(**given):
        opened.append(open_source(DEFAULTS | {name: str(value) if isinstance(value, Path) else value
                                              for name, value in given.items()}))
        return opened[-1]

    yield open_with
    for each in opened:
        each.close()


@pytest.fixture(scope="module")
def described(sensor) -> list[bytes]:
    return [sensor_message.encode_cdr(sensor.replace(num_bins=bins)) for bins in (100, 90)]


@pytest.fixture(scope="module")
def frames(sensor) -> list[bytes]:
    """Four frames, acquired 10 ms apart and 3 ms before they are recorded."""
    events = [PhotonEvents(np.array([k], np.uint32), np.array([k], np.uint16), START_NS + (10 * k + 7) * MS)
              for k in range(4)]
    return [photons.encode_cdr(each, sensor, "spad") for each in events]


@pytest.fixture(scope="module")
def bag(described, frames, tmp_path_factory) -> Path:
    """Recorded in ms: sensor 0 and again 22, another 25, frames 10, 20, 30, 40."""
    sensors = [("/spad/info", TEXT, described[which], at_ms) for at_ms, which in ((0, 0), (22, 0), (25, 1))]
    photons = [("/spad/raw", CLOUD, raw, 10 * (k + 1)) for k, raw in enumerate(frames)]
    return write_bag(tmp_path_factory.mktemp("bags") / "bag", sorted(sensors + photons, key=lambda one: one[3]))


def same_photons(one: PhotonEvents, other: PhotonEvents) -> bool:
    """True if both hold the same photons in any order."""
    return sorted(zip(one.pixel, one.toa)) == sorted(zip(other.pixel, other.toa))


@pytest.mark.parametrize("output", ["gates", "histograms"])
def test_without_loop_a_file_is_one_frame_also_in_other_forms(source, photon_file, events, output):
    played = source(input=photon_file, loop=False, output=output)
    frame, = played.items()
    described = sensor_message.decode_cdr(played.sensor)
    assert frame.topic == output
    assert same_photons(CODECS[output].decode_cdr(frame.raw, described)[1].to_events(described), events)


def test_a_bag_is_played_as_it_was_recorded(source, bag, described, frames):
    played = source(input=bag)
    assert (played.output, played.sensor, played.recorded_ns) == ("photons", described[0], START_NS)
    assert [(item.topic, item.due_ns // MS, item.raw) for item in played.items()] == [
        ("photons", 10, frames[0]), ("photons", 20, frames[1]), ("sensor", 25, described[1]),
        ("photons", 30, frames[2]), ("photons", 40, frames[3])]
    stamps = [item.stamp_ns for item in played.items() if item.topic == "photons"]
    assert stamps == [START_NS + (10 * k + 7) * MS for k in range(4)]


@pytest.fixture(scope="module")
def report() -> bytes:
    message = Odometry(child_frame_id="base")
    message.header.stamp = Time(nanoseconds=START_NS + 5 * MS).to_msg()
    return serialize_message(message)


def test_odometry_of_a_bag_is_played_if_it_is_the_only_one(source, described, frames, tmp_path, report):
    write_bag(tmp_path / "bag", [("/spad/info", TEXT, described[0], 0), ("/spad/raw", CLOUD, frames[0], 10),
                                 ("/base/odometry", ODOMETRY, report, 11)])
    opened = source(input=tmp_path / "bag")
    assert (opened.others, opened.notes) == (("odom",), ())
    items = list(opened.items())
    assert [(item.topic, item.due_ns // MS) for item in items] == [("photons", 10), ("odom", 11)]
    assert (items[1].raw, items[1].stamp_ns) == (report, START_NS + 5 * MS)


def test_of_several_topics_of_motion_none_is_played_and_a_line_names_them(source, described, frames, tmp_path, report):
    bag = write_bag(tmp_path / "bag", [("/spad/info", TEXT, described[0]), ("/spad/raw", CLOUD, frames[0]),
                                       ("/raw", ODOMETRY, report), ("/filtered", ODOMETRY, report)])
    opened = source(input=bag)
    assert opened.notes == ("nothing is played on odom: the bag has /raw and /filtered",)
    assert [item.topic for item in opened.items()] == ["photons"]


def test_a_bag_of_sketches_is_played_with_their_descriptions(source, sensor, described, tmp_path):
    raw = sketch_message.encode_cdr(noise_sketch(sensor, (1, 2)), sensor, "spad")
    played = source(input=write_bag(tmp_path / "bag", [
        ("/sketch/sensor", TEXT, described[0]), ("/sketch", CLOUD, raw), ("/sketch/sensor", TEXT, described[1])]))
    assert (played.output, played.describes, played.sensor) == ("sketch", "sketch/sensor", described[0])
    assert [(item.topic, item.raw) for item in played.items()] == [("sketch", raw), ("sketch/sensor", described[1])]


@pytest.mark.parametrize("given, line", [
    ({"input": "nowhere.npz"}, "nowhere.npz"),
    ({"sensor_file": "sensor.json"}, "sensor_file is sensor.json: expected nothing, unless a photon file is played"),
    ({"input": "bag", "rate_hz": 5.0}, "rate_hz is 5.0: expected 10.0, as a bag is played as it was recorded"),
    ({"input": "srt3d_ros"}, "bag is srt3d_ros, without metadata.yaml: expected a complete rosbag2 bag"),
])
def test_what_is_no_source_is_refused(source, repository, monkeypatch, bag, given, line):
    monkeypatch.chdir(bag.parent if given.get("input") == "bag" else repository)
    with pytest.raises(InvalidInput, match=line):
        source(**given)


# ---- A sensor that moves: packets and odometry of one time

@pytest.fixture
def moving():
    return lambda **given: MovingSource(DEFAULTS | {"motion": "walk", "frames": 1} | given)


def test_packets_come_when_they_are_acquired_among_odometry_that_covers_them(moving):
    items = list(moving(rate_hz=20.0, ppp=2.0).items())
    assert all(before.due_ns <= after.due_ns for before, after in pairwise(items))
    packets = [item for item in items if item.topic == "photons"]
    assert [item.stamp_ns for item in packets] == [BEFORE_NS + k * 5 * MS for k in range(PACKETS)]
    assert [item.due_ns - item.stamp_ns for item in packets] == [5 * MS] * PACKETS
    stamps = [item.stamp_ns for item in items if item.topic == "odom"]
    assert stamps[0] == 0 and stamps[-1] >= BEFORE_NS + 100 * MS and set(np.diff(stamps)) == {10 * MS}


def test_the_extrinsics_that_it_tells_are_where_the_sensor_is(moving):
    note, = moving().notes
    np.testing.assert_allclose(parse_extrinsics(note.split("'")[-2]).rotation, OPTICAL.rotation, atol=1e-9)
