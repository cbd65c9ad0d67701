"""The bag recorder: what it is sent is in the bag, the description first; every way in which a bag may end."""

import signal
from pathlib import Path

import numpy as np
import pytest
from rclpy.duration import Duration
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonGates
from srt3d_ros.datasets.bags.bag import Bag, Message
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message

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


def on_the_wire(raw: bytes) -> bytes:
    """A serialised message as subscribers get it: the middleware fills it up to a multiple of 4 bytes."""
    return raw + bytes(-len(raw) % 4)


def test_what_is_recorded_gives_the_same_clouds_again(graph, sensor, frames, tmp_path):
    """Bit for bit, over two descriptions of the sensor."""
    clouds, described = graph.collect(PointCloud2, "points", raw=True), graph.collect_latched(String, "sketch/sensor")
    bag = tmp_path / "bag"
    nodes = [graph.start(name) for name in ("reconstructor", "sketcher")]
    recorder = graph.start("bag_recorder", path=bag)
    for process in (*nodes, recorder):
        process.ready()
    driver, sensors = graph.matched(graph.publisher(PointCloud2, "photons"), 2), graph.latched("sensor")
    descriptions = [sensor_message.encode_cdr(each) for each in (sensor, sensor.replace(num_bins=90))]
    sent = (descriptions[0], *frames[:4], descriptions[1], *frames[4:])
    for number, raw in enumerate(sent, start=1):
        (sensors if raw in descriptions else driver).publish(raw)
        graph.reports("bag_recorder", "frames_out", number)
        turns = sum(one in descriptions for one in sent[:number])
        graph.wait(lambda: len(described) == turns and len(clouds) == number - turns, "what is made of it")
    live = list(clouds)
    assert all(1 < len(points_message.decode_cdr(raw)[1]["xyz"]) for raw in live)
    assert recorder.end(signal.SIGINT) == 0 and recorder.lines[-1].endswith("MB, nothing lost")
    assert f"{graph.namespace}/photons 6, {graph.namespace}/sensor 2, " in recorder.lines[-1], recorder.text
    assert [message.raw for message in read(bag)] == [on_the_wire(raw) for raw in sent]
    for publisher in (sensors, driver):
        graph.node.destroy_publisher(publisher)
    clouds.clear()
    assert graph.start("player", input=bag).code() == 0
    graph.wait(lambda: len(clouds) == len(live), "the clouds of the bag")
    assert list(clouds) == live
    assert {graph.report(name)["dropped"] for name in ("sketcher", "reconstructor")} == {"0"}


# The node after a line of Python, as a program of its own.
PROGRAM = """import os, resource, sys
from srt3d_ros.nodes import bag_recorder
{line}
sys.exit(bag_recorder.main())
"""
FILLS_UP = ("from types import SimpleNamespace; room = iter([10**12] * 2); "
            "bag_recorder.shutil.disk_usage = lambda path: SimpleNamespace(free=next(room, 256 * 10**6))")
SLOW_DISK = ("import time; bag_recorder.QUEUE_MB = 1; write = bag_recorder.BagRecorderNode._write; "
             "bag_recorder.BagRecorderNode._write = lambda *of: (time.sleep(1), write(*of))")
FILE_TOO_LARGE = "resource.setrlimit(resource.RLIMIT_FSIZE, (900_000, 900_000))"


@pytest.fixture
def record_gates(graph, sensor, tmp_path):
    """Send four messages of 0.384 MB to a recorder of `gates`, in a program with a line of its own."""
    def record(line: str):
        program = tmp_path / "program.py"
        program.write_text(PROGRAM.format(line=line))
        recorder = graph.start(str(program), path=tmp_path / "bag", topics="gates").ready()
        driver = graph.matched(graph.publisher(Image, "gates"))
        words = np.zeros((1000, sensor.rows, sensor.cols), np.uint16)
        for k in range(4):
            driver.publish(gates_message.encode_cdr(PhotonGates(words, START_NS + k), sensor, "spad"))
        driver.wait_for_all_acked(Duration(seconds=30))
        return recorder

    return record


@pytest.mark.parametrize("line, said", [(FILLS_UP, "ended with less than 256 MB free on the disk"),
                                        (FILE_TOO_LARGE, "cannot be written (File too large)")])
def test_a_full_disk_is_one_line_and_exit_code_1_and_the_bag_is_complete_if_it_was_seen_to_fill(
        record_gates, tmp_path, line, said):
    recorder = record_gates(line)
    assert recorder.code() == 1 and said in recorder.lines[-1], recorder.text
    assert recorder.text.count("ERROR") == (line == FILE_TOO_LARGE) and "Traceback" not in recorder.text
    assert line != FILLS_UP or ("/gates 2, " in recorder.lines[-1] and len(read(tmp_path / "bag")) == 2)


def test_what_the_disk_is_too_slow_for_is_dropped_and_what_waits_is_written_at_the_end(graph, record_gates, tmp_path):
    recorder = record_gates(SLOW_DISK)
    graph.reports("bag_recorder", "messages_in", 4)
    assert recorder.end(signal.SIGINT) == 0
    written = len(read(tmp_path / "bag"))
    assert 2 <= written < 4 and recorder.lines[-1].endswith(f"{4 - written} lost"), recorder.text
