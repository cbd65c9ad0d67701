"""The bag recorder: what it is sent is in the bag, the description first; every way in which a bag may end."""

import signal
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from ruamel.yaml import YAML
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.datasets.bag import Bag, Message
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes.bag_recorder import TOPICS

START_NS, APART_NS = 1_500_000_000_000_000_000, 500_000_000


@pytest.fixture(scope="module")
def frames(sensor) -> list[bytes]:
    """Six frames of a plane that comes nearer, no two alike."""
    rng = np.random.default_rng(2)
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 30)
    made = []
    for k in range(6):
        background = rng.random(len(pixel)) < 0.3
        toa = np.where(background, rng.integers(0, 90, len(pixel)), rng.normal(60 - 4 * k, 2, len(pixel)))
        events = PhotonEvents(pixel, np.clip(np.round(toa), 0, 89).astype(np.uint16), START_NS + k * APART_NS)
        made.append(photons_message.encode_cdr(events, sensor, "spad"))
    return made


def read(path: Path) -> list[Message]:
    with Bag(path) as bag:
        return list(bag.messages(bag.topics))


def offers(path: Path) -> dict[str, tuple]:
    """What the metadata says that the publishers of each topic offered."""
    information = YAML(typ="safe").load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = [topic["topic_metadata"] for topic in information["topics_with_message_count"]]
    return {topic["name"].rsplit("/", 1)[1]: tuple(
        (offer["reliability"], offer["durability"], offer["depth"]) for offer in topic["offered_qos_profiles"])
        for topic in topics}


def on_the_wire(raw: bytes) -> bytes:
    """A serialised message as subscribers get it: the middleware fills it up to a multiple of 4 bytes."""
    return raw + bytes(-len(raw) % 4)


def test_what_is_recorded_gives_the_same_clouds_again(graph, sensor, frames, tmp_path):
    """Bit for bit: bags of photons of both kinds, and one of coded sketches, played into the same nodes."""
    clouds, described = graph.collect(PointCloud2, "points", raw=True), graph.collect_latched(String, "sketch/sensor")
    sketcher = graph.start("sketcher", lossless=True, layout="coded", sketch_size=8)
    nodes = [graph.start("reconstructor", lossless=True), sketcher]
    parameters = {"mcap": {}, "sqlite3": {"format": "sqlite3"}, "sketches": {"topics": "sketch, sketch/sensor"}}
    bags = {kind: tmp_path / kind for kind in parameters}
    recorders = {kind: graph.start("bag_recorder", "-r", f"__node:={kind}", path=path, **parameters[kind])
                 for kind, path in bags.items()}
    for process in (*nodes, *recorders.values()):
        process.ready()
    driver, sensors = graph.matched(graph.publisher(PointCloud2, "photons"), 3), graph.latched("sensor")
    descriptions = [sensor_message.encode_cdr(each) for each in (sensor, sensor.replace(num_bins=90))]
    for turn, (description, part) in enumerate(zip(descriptions, (frames[:4], frames[4:]))):
        sensors.publish(description)
        graph.wait(lambda: len(described) == turn + 1, "sketch/sensor")
        for k, frame in enumerate(part):
            driver.publish(frame)
            graph.wait(lambda: len(clouds) == 4 * turn + k + 1, "a cloud")
        for kind in bags:
            graph.reports(kind, "frames_out", (5, 8)[turn])
    live, namespace = list(clouds), graph.namespace
    assert all(1 < len(points_message.decode_cdr(raw)[1]["xyz"]) for raw in live)
    for kind, recorder in recorders.items():
        assert recorder.end(signal.SIGINT if kind == "mcap" else signal.SIGTERM) == 0
        assert recorder.lines[-1].endswith("MB, nothing lost")
        if kind != "sketches":
            assert f"{namespace}/photons 6, {namespace}/sensor 2, " in recorder.lines[-1], recorder.text
            assert [message.raw for message in read(bags[kind])] == [
                on_the_wire(raw) for raw in (descriptions[0], *frames[:4], descriptions[1], *frames[4:])]
            assert offers(bags[kind])["sensor"] == (("reliable", "transient_local", 1),)
            assert [offer[:2] for offer in offers(bags[kind])["photons"]] == [("reliable", "volatile")]
    for publisher in (sensors, driver):
        graph.node.destroy_publisher(publisher)
    for kind, bag in bags.items():
        if kind == "sketches":          # the sketcher's description would contradict that in the bag
            assert sketcher.end(signal.SIGINT) == 0
        clouds.clear()
        assert graph.start("player", input=bag, lossless=True, bag_rate=0.0).code() == 0
        graph.wait(lambda: len(clouds) == len(live), f"the clouds of {kind}")
        assert list(clouds) == live
    assert {graph.report(name)["dropped"] for name in ("sketcher", "reconstructor")} == {"0"}


def test_before_simulated_time_frames_are_dropped_and_the_description_is_recorded_where_time_jumps_back(
        graph, sensor, frames, tmp_path):
    """A frame without a time would be at 1970. A bag is read in order of time, in which a description comes first."""
    recorder = graph.start("bag_recorder", path=tmp_path / "bag", use_sim_time=True).ready()
    driver = graph.matched(graph.publisher(PointCloud2, "photons"))
    clock = graph.matched(graph.node.create_publisher(Clock, "/clock", 10))
    graph.latched("sensor").publish(sensor_message.encode_cdr(sensor))
    driver.publish(frames[0])
    graph.reports("bag_recorder", "dropped.no_time", 1)
    for seconds in (0, -100, -99, 2):
        before = graph.total("bag_recorder", "frames_out")
        stamp = START_NS // 10**9 + seconds

        def recorded() -> bool:
            clock.publish(Clock(clock=Time(sec=stamp)))
            driver.publish(frames[0])
            return graph.total("bag_recorder", "frames_out") > before + 4

        graph.wait(recorded, "frames to be recorded")
    assert recorder.end(signal.SIGINT) == 0
    described, seen = on_the_wire(sensor_message.encode_cdr(sensor)), {}
    for message in read(tmp_path / "bag"):
        seen.setdefault(message.time_ns - START_NS, message.raw)
    firsts = {offset // 10**9: raw == described for offset, raw in seen.items()}
    assert firsts[-100] and firsts[0] and firsts[2] and not firsts[-99]


def test_frames_that_nobody_describes_are_recorded_and_topics_without_messages_are_named(graph, frames, tmp_path):
    recorders = {topics: graph.start("bag_recorder", "-r", f"__node:={name}", path=tmp_path / name, topics=topics)
                 for name, topics in (("by_default", TOPICS), ("chosen", "photons, gates, points"))}
    for recorder in recorders.values():
        recorder.ready()
    graph.matched(graph.publisher(PointCloud2, "photons"), 2).publish(frames[0])
    for name, recorder, missing in zip(("by_default", "chosen"), recorders.values(), (["sensor"], ["gates", "points"])):
        graph.reports(name, "frames_out", 1)
        assert recorder.end(signal.SIGTERM) == 0
        names = " and ".join(f"{graph.namespace}/{topic}" for topic in missing)     # by default one form is enough
        assert recorder.lines[-1].endswith(f" MB, no message came on {names}") and "WARN" in recorder.lines[-1]
        assert ("no description on sensor yet: recording without" in recorder.text) == (name == "by_default")
        assert [message.raw for message in read(tmp_path / name)] == [on_the_wire(frames[0])]


# The node after a line of Python, as a program of its own.
PROGRAM = """import os, resource, sys
from srt3d_ros.nodes import bag_recorder
{line}
sys.exit(bag_recorder.main())
"""
FILLS_UP = ("room = iter([10**9] * 4); real = os.statvfs; "
            "os.statvfs = lambda path: os.statvfs_result([*real(path)[:4], next(room, 0), *real(path)[5:]])")
BUSY = ("import time; received = bag_recorder.BagRecorderNode._received; "
        "bag_recorder.BagRecorderNode._received = lambda *of: (time.sleep(0.3), received(*of))")
FILE_TOO_LARGE = "resource.setrlimit(resource.RLIMIT_FSIZE, (900_000, 900_000))"


@pytest.fixture
def record_gates(graph, sensor, tmp_path):
    """Send four messages of 0.384 MB to a recorder of `gates`, in a program with a line of its own if there is one."""
    def record(line: str = "", **parameters):
        program = tmp_path / "program.py"
        program.write_text(PROGRAM.format(line=line))
        recorder = graph.start(str(program), **{"path": tmp_path / "bag", "topics": "gates"} | parameters).ready()
        driver = graph.matched(graph.publisher(Image, "gates"))
        words = np.zeros((1000, sensor.rows, sensor.cols), np.uint16)
        for k in range(4):
            driver.publish(gates_message.encode_cdr(PhotonGates(words, START_NS + k), sensor, "spad"))
        driver.wait_for_all_acked(Duration(seconds=30))
        return recorder

    return record


@pytest.mark.parametrize("line, limit, code, messages, words", [
    ("", {"max_size_mb": 1}, 0, 2, "ended by max_size_mb"),
    ("", {"max_duration_s": 1e-9}, 0, 1, "ended by max_duration_s"),
    (FILLS_UP, {}, 1, 2, "ended with less than 256 MB free on the disk"),
])
def test_a_bag_that_reaches_a_limit_is_complete(record_gates, tmp_path, line, limit, code, messages, words):
    recorder = record_gates(line, **limit)
    assert recorder.code() == code
    assert f"/gates {messages}, " in recorder.lines[-1] and recorder.lines[-1].endswith(words), recorder.text
    assert len(read(tmp_path / "bag")) == messages


def test_frames_wait_for_their_description_as_long_as_the_queue_holds_them(graph, sensor, record_gates, tmp_path):
    recorder = record_gates("bag_recorder.HOLD_S = 1000", topics="gates,sensor", queue_mb=1)
    graph.reports("bag_recorder", "dropped.queue", 2)
    assert graph.report("bag_recorder")["frames_out"] == "0"
    graph.latched("sensor").publish(sensor_message.encode_cdr(sensor))
    graph.reports("bag_recorder", "frames_out", 3)
    assert recorder.end(signal.SIGINT) == 0
    assert recorder.lines[-1].endswith("lost: 2 because the queue was full")
    messages = read(tmp_path / "bag")
    assert [message.topic.rsplit("/", 1)[1] for message in messages] == ["sensor", "gates", "gates"]
    assert messages[0].time_ns == messages[1].time_ns < messages[2].time_ns


def test_what_has_come_before_the_end_is_written_though_it_waits_and_the_node_is_busy(record_gates, tmp_path):
    """In the queue for a description, and in the middleware for the node to take it."""
    recorder = record_gates(f"{BUSY}; bag_recorder.HOLD_S = 1000", topics="gates,sensor")
    assert recorder.end(signal.SIGINT) == 0
    assert len(read(tmp_path / "bag")) == 4, recorder.text


def test_a_bag_that_can_no_longer_be_written_is_one_line_and_exit_code_1(record_gates):
    recorder = record_gates(FILE_TOO_LARGE)
    assert recorder.code() == 1
    assert "cannot be written (File too large)" in recorder.lines[-1], recorder.text
    assert recorder.text.count("ERROR") == 1 and "Traceback" not in recorder.text


@pytest.mark.parametrize("parameters, line", [
    ({"topics": "photons, gps"}, "topics is gps: expected some of sensor, sketch/sensor, photons, gates, "),
    ({"min_free_mb": 10**9}, "expected a place with more than 1000000000 MB free"),
])
def test_what_cannot_be_recorded_is_one_line_and_exit_code_2(graph, tmp_path, parameters, line):
    recorder = graph.start("bag_recorder", path=tmp_path / "bag", **parameters)
    assert recorder.code() == 2
    assert len(recorder.lines) == 1 and line in recorder.text
    assert not (tmp_path / "bag").exists()


def test_deactivated_it_completes_the_bag_and_overwrites_none(graph, frames, tmp_path):
    recorder = graph.start("bag_recorder", path=tmp_path / "bag", topics="photons").ready()
    graph.matched(graph.publisher(PointCloud2, "photons")).publish(frames[0])
    graph.reports("bag_recorder", "frames_out", 1)
    assert graph.change("bag_recorder", "deactivate")
    assert len(read(tmp_path / "bag")) == 1
    assert not graph.change("bag_recorder", "activate")
    recorder.says("expected a folder that is not there")
    assert recorder.end(signal.SIGINT) == 0
