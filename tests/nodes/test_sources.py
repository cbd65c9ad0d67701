"""What the player plays, message by message: what is due when, with which stamps, and where it begins and ends."""

from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photons
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes import player
from srt3d_ros.nodes.sources import Item, open_source, reports_first

START_NS = 1_600_000_000_000_000_000
MS = 1_000_000


@pytest.fixture
def source():
    """Open the source that these parameters describe; closed after the test."""
    opened = []

    def open_with(**given):
        defaults = {parameter.name: parameter.default for parameter in player.PARAMETERS}
        opened.append(open_source(defaults | {name: str(value) if isinstance(value, Path) else value
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


def write(path: Path, types: dict[str, str], messages: list[tuple[float, str, bytes]]) -> Path:
    """A bag of topics of these types, with messages recorded at so many milliseconds."""
    writer = BagWriter(path)
    for topic, type_name in types.items():
        writer.add_topic(topic, type_name, [Offer()])
    for at_ms, topic, raw in messages:
        writer.write(topic, START_NS + round(at_ms * MS), raw)
    writer.close()
    return path


TYPES = {"/spad/info": "std_msgs/msg/String", "/spad/raw": "sensor_msgs/msg/PointCloud2"}


@pytest.fixture(scope="module")
def bag(described, frames, tmp_path_factory) -> Path:
    """Recorded in ms: sensor 0 and again 22, another 25, frames 10, 20, 30, 40."""
    return write(tmp_path_factory.mktemp("bags") / "bag", TYPES, [
        (0, "/spad/info", described[0]), (10, "/spad/raw", frames[0]), (20, "/spad/raw", frames[1]),
        (22, "/spad/info", described[0]), (25, "/spad/info", described[1]), (30, "/spad/raw", frames[2]),
        (40, "/spad/raw", frames[3])])


def test_frames_of_a_file_are_due_at_its_rate_until_the_time_is_over(source, photon_file, events):
    played = source(input=photon_file, rate_hz=50.0, duration_s=0.05)
    items = list(played.items())
    assert [(item.topic, item.due_ns, item.acquired_ns, item.stamp_ns) for item in items] == [
        ("photons", k * 20 * MS, k * 20 * MS, None) for k in range(3)]
    assert {item.photons for item in items} == {events.photons} and len({id(item.raw) for item in items}) == 1


def same_photons(one: PhotonEvents, other: PhotonEvents) -> bool:
    """True if both hold the same photons in any order."""
    return sorted(zip(one.pixel, one.toa)) == sorted(zip(other.pixel, other.toa))


@pytest.mark.parametrize("output", ["gates", "histograms"])
def test_without_loop_a_file_is_one_frame_also_in_other_forms(source, photon_file, events, output):
    played = source(input=photon_file, loop=False, output=output)
    frame, = played.items()
    described = sensor_message.decode_cdr(played.sensor)
    assert (frame.topic, frame.photons) == (output, events.photons)
    assert same_photons(CODECS[output].decode_cdr(frame.raw, described)[1].to_events(described), events)


def test_the_simulator_has_no_end_and_is_played_with_its_parameters(source):
    played, simulator = source(ppp=0.5, sbr=2.0, seed=3, loop=False), Simulator(ppp=0.5, sbr=2.0, seed=3)
    described = sensor_message.decode_cdr(played.sensor)
    assert described.same_as(simulator.sensor)
    for k, item in enumerate(islice(played.items(), 3)):
        assert same_photons(photons.decode_cdr(item.raw, described)[1], simulator.frame(k)[0])


def test_a_bag_is_played_as_it_was_recorded(source, bag, described, frames):
    played = source(input=bag)
    assert (played.output, played.sensor, played.rate, played.start_ns) == ("photons", described[0], 1.0, START_NS)
    assert [(item.topic, item.due_ns // MS, item.raw) for item in played.items()] == [
        ("photons", 10, frames[0]), ("photons", 20, frames[1]), ("sensor", 25, described[1]),
        ("photons", 30, frames[2]), ("photons", 40, frames[3])]
    stamps = [(item.stamp_ns, item.acquired_ns, item.time_ns) for item in played.items() if item.topic == "photons"]
    assert stamps == [(START_NS + (10 * k + 7) * MS, (10 * k + 7) * MS, START_NS + (10 * k + 10) * MS)
                      for k in range(4)]


@pytest.fixture(scope="module")
def report() -> bytes:
    message = Odometry(child_frame_id="base")
    message.header.stamp = Time(nanoseconds=START_NS + 5 * MS).to_msg()
    return serialize_message(message)


def test_odometry_of_a_bag_is_played_if_it_is_the_only_one(source, described, frames, tmp_path, report):
    write(tmp_path / "bag", TYPES | {"/base/odometry": "nav_msgs/msg/Odometry"}, [
        (0, "/spad/info", described[0]), (10, "/spad/raw", frames[0]), (11, "/base/odometry", report)])
    opened = source(input=tmp_path / "bag")
    assert (opened.others, opened.notes) == (("odom",), ())
    items = list(opened.items())
    assert [(item.topic, item.due_ns // MS) for item in items] == [("photons", 10), ("odom", 11)]
    assert (items[1].raw, items[1].stamp_ns, items[1].acquired_ns) == (report, START_NS + 5 * MS, 5 * MS)


@pytest.mark.parametrize(("name", "holds"), [("odom", "nav_msgs/msg/Odometry"), ("imu", "sensor_msgs/msg/Imu")])
def test_of_several_topics_of_motion_a_line_asks_for_one_and_the_chosen_is_played(source, described, frames, tmp_path,
                                                                                 report, name, holds):
    bag = write(tmp_path / "bag", TYPES | dict.fromkeys(("/raw", "/filtered"), holds), [
        (0, "/spad/info", described[0]), (10, "/spad/raw", frames[0]), (11, "/raw", report), (12, "/filtered", report)])
    opened = source(input=bag)
    assert opened.notes == (f"nothing is played on {name}: bag_{name}_topic can be /raw or /filtered",)
    assert [item.topic for item in opened.items()] == ["photons"]
    chosen = source(input=bag, **{f"bag_{name}_topic": "/filtered"})
    assert (chosen.others, chosen.notes) == ((name,), ())
    assert [(item.topic, item.due_ns // MS) for item in chosen.items()] == [("photons", 10), (name, 12)]
    with pytest.raises(InvalidInput, match=f"bag_{name}_topic is /spad/raw: expected a topic of {holds}"):
        source(input=bag, **{f"bag_{name}_topic": "/spad/raw"})


def test_reports_of_the_motion_come_before_the_frames_that_wait_for_them_and_a_loop_holds_nothing_back():
    turn = [("photons", 0), ("photons", 100), ("odom", 150), ("photons", 250), ("odom", 440)]
    played = [Item(topic, b"", 0, time_ns=ms * MS) for topic, ms in turn * 2]
    moving = SimpleNamespace(others=("odom",), items=lambda: iter(played))
    once = [("odom", 150), ("photons", 0), ("photons", 100), ("odom", 440), ("photons", 250)]
    assert [(item.topic, item.time_ns // MS) for item in reports_first(moving)] == once * 2


def test_the_pace_of_a_bag_can_be_changed(source, bag):
    twice = [(item.due_ns, item.acquired_ns) for item in source(input=bag, bag_rate=2.0).items()]
    assert twice[:2] == [(5 * MS, 3.5 * MS), (10 * MS, 8.5 * MS)]
    assert {item.due_ns for item in source(input=bag, bag_rate=0.0, lossless=True).items()} == {0}


def test_a_part_of_a_bag_begins_with_the_sensor_in_force(source, bag, described, frames):
    early = source(input=bag, bag_start_s=0.015, duration_s=0.012)
    assert early.sensor == described[0]
    assert [(item.due_ns // MS, item.raw) for item in early.items()] == [(5, frames[1]), (10, described[1])]
    late = source(input=bag, bag_start_s=0.03)
    assert late.sensor == described[1] and [item.raw for item in late.items()] == frames[2:]


def test_a_bag_in_a_loop_goes_on_a_mean_interval_after_its_end_with_its_first_sensor(source, bag, described, frames):
    items = list(islice(source(input=bag, bag_loop=True).items(), 8))
    assert [item.raw for item in items[5:]] == [described[0], frames[0], frames[1]]
    # 40 ms long, 7 messages: the next turn begins 40 / 6 ms later
    assert [item.due_ns - 40 * MS for item in items[5:]] == [6_666_666, 16_666_666, 26_666_666]
    assert [item.stamp_ns for item in items[6:]] == [START_NS + 7 * MS, START_NS + 17 * MS]


def test_a_message_without_a_stamp_is_played_for_others_to_count(source, tmp_path, described, frames):
    write(tmp_path / "bag", {"/photons": TYPES["/spad/raw"]}, [
        (k, "/photons", raw) for k, raw in enumerate((frames[0], b"\0\1\0\0", frames[1]))])
    played = source(input=tmp_path / "bag")
    assert [(item.raw, item.stamp_ns) for item in played.items()][1] == (b"\0\1\0\0", START_NS + MS)
    assert played.sensor is None and "no sensor is described beside /photons" in played.notes[0]


@pytest.mark.parametrize("given, line", [
    ({"bag_rate": 0.0}, "bag_rate is 0.0: expected above 0, or lossless"),
    ({"frame_id": "mast"}, "frame_id is mast: expected nothing: a bag is sent as it was recorded"),
    ({"bag_photons_topic": "/raw"}, "photons_topic is /raw: expected .*/spad/raw"),
    ({"bag_start_s": 0.05}, "bag_start_s is 0.05: expected a time after which /spad/raw has messages"),
    ({"bag_start_s": 0.021, "duration_s": 0.004}, "bag_start_s is 0.021: expected a time after which"),
])
def test_a_bag_that_cannot_be_played_so_is_refused(source, bag, given, line):
    with pytest.raises(InvalidInput, match=line):
        source(input=bag, **given)


@pytest.mark.parametrize("given, line", [
    ({"input": "nowhere.npz"}, "nowhere.npz"),
    ({"rate_hz": 0.0}, "rate_hz is 0.0: expected above 0 Hz"),
    ({"rate_hz": 0.0, "lossless": True, "duration_s": 1.0}, "rate_hz is 0.0: expected above 0 Hz with duration_s"),
    ({"input": "srt3d_ros"}, "bag is srt3d_ros, without metadata.yaml: expected a complete rosbag2 bag"),
])
def test_what_is_no_source_is_refused(source, repository, monkeypatch, given, line):
    monkeypatch.chdir(repository)
    with pytest.raises(InvalidInput, match=line):
        source(**given)
