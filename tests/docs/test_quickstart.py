"""docs/quickstart-driver.md does what it says: its own blocks are run, from the description to the measured IRF."""

import json
import os
import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.datasets import open_sensor
from srt3d_ros.messages import points as points_message
from srt3d_ros.recording.reader import RecordingReader
from tests.nodes.conftest import Graph
from tests.processes import Process

from .pages import PAGES, ROOT, fenced, indented, inline, section

PAGE = PAGES["docs/quickstart-driver.md"]
DESCRIPTION = fenced(section(PAGE, "2"), "json")[0]
DRIVER, OF_HISTOGRAMS = "examples/spad_driver.py", "examples/histogram_driver.py"
COMPILE_S = 900.0       # on a slow machine with other work, once
RECORDED = 60           # messages: more than the snippet of the page reads
WORDS = "is|are|of|on|expected|no_sensor|malformed|queue|my_sensor|json"
VARIABLE = re.compile(rf'…|[\d.]+|/\w+|"\w+"|[:,;()]|\b(?:{WORDS})\b')
PUT_TOGETHER = {"offering incompatible QoS", "waiting for a sensor description", "waiting for a frame"}    # of words


@pytest.fixture
def graph(ros):
    graph = Graph("/")
    yield graph
    graph.close()


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> None:
    """Where steps 1 and 2 leave the reader: in a folder with the files that the page names, `python` and `srt3d`."""
    for name in ("config", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "my_sensor.json").write_text(DESCRIPTION)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")


def terminal(lines: str) -> Process:
    """A shell in which the lines are typed; what signals reach is the last line's program."""
    *before, last = [line for line in lines.splitlines() if line.strip()]
    return Process(["bash", "-ec", "\n".join([*before, f"exec {last}"])])


def typed(step: str, text: str) -> str:
    """The indented block of a step that has this text."""
    (block,) = [block for block in indented(section(PAGE, step)) if text in block]
    return block


def ranges_m(cloud: PointCloud2) -> np.ndarray:
    return np.linalg.norm(points_message.decode_cdr(serialize_message(cloud))[1]["xyz"], axis=1)


def test_the_page_from_the_description_to_the_measured_irf(graph, checkout):
    check, compiled = terminal(typed("2", "open_sensor")), terminal("srt3d compile")
    assert check.code() == 0 and " ".join(check.text.split()) in inline(section(PAGE, "2")), check.text
    assert "srt3d compile" in typed("1", "compile") and compiled.code(COMPILE_S) == 0, compiled.text
    clouds = graph.collect(PointCloud2, "/points")
    driver, up = (terminal(typed("4", text)) for text in (DRIVER, "srt3d up"))
    graph.processes += [driver, up]
    up.says("recording to")
    before = len(clouds)
    graph.wait(lambda: len(clouds) > before + 3, "clouds")
    assert up.end(signal.SIGINT) == 0 and len(RecordingReader(Path("run.rrd")).cloud_index()), up.text
    bag = terminal(typed("5", "bag-record"))
    graph.processes.append(bag)
    graph.wait(lambda: graph.total("bag_recorder", "frames_out") > RECORDED, "a second of frames in the bag")
    assert bag.end(signal.SIGINT) == driver.end(signal.SIGINT) == 0, (bag.text, driver.text)
    assert not any("Traceback" in one.text for one in (up, bag, driver))
    assert clouds[-1].header.frame_id == "spad_optical"
    range_said, bin_said = map(float, re.search(r"points are all ([\d.]+) m\s+away, which is bin (\d+)", PAGE).groups())
    off_m = ranges_m(clouds[-1]) - range_said
    assert len(off_m) > 0.9 * 32 * 32 and abs(np.median(off_m)) < 0.01 and np.percentile(np.abs(off_m), 95) < 0.05
    assert range_said == pytest.approx(bin_said * 250e-12 * 299_792_458 / 2, abs=0.005)
    found = [float(value) for value in re.search(r"finds ((?:[\d.]+, )+[\d.]+\d)", section(PAGE, "5"))[1].split(", ")]
    exec(fenced(section(PAGE, "5"), "python")[0], {})
    sensor = json.loads(Path("my_sensor.json").read_text())
    assert sensor["irf"][sensor["irf_ref"] - len(found) // 2:][:len(found)] == pytest.approx(found, abs=0.01)
    assert open_sensor("my_sensor.json").irf_ref == sensor["irf_ref"]


def test_the_driver_of_histograms_gives_clouds_where_the_page_says(graph, checkout):
    clouds = graph.collect(PointCloud2, "/points")
    graph.processes += [terminal(f"python {OF_HISTOGRAMS}"), terminal("srt3d up")]
    graph.wait(lambda: len(clouds) > 3, "clouds")
    range_m = ranges_m(clouds[-1])
    assert len(range_m) > 0.9 * 32 * 48
    assert np.abs(np.median(range_m) - float(re.search(r"scene is ([\d.]+) m away", PAGE)[1])) < 0.01


@pytest.mark.parametrize("driver", [DRIVER, OF_HISTOGRAMS])
def test_the_drivers_are_forty_lines_without_this_package(driver):
    text = (ROOT / driver).read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) <= 40
    assert "srt3d_ros" not in re.sub('""".*?"""', "", text)


def test_the_table_of_troubles_quotes_the_source_and_what_the_middleware_says(graph):
    """tests/nodes has the other causes: silence, clocks, contradictions, bad messages, losses, overload."""
    source = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "srt3d_ros").rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)        # literals of several lines
    messages = [code for code in inline(section(PAGE, "When nothing comes")) if len(code.split()) > 2]
    sentences = [message for message in messages if not message.startswith(("ros2", "srt3d"))]
    parts = {part.strip() for message in sentences for part in VARIABLE.split(message)}
    assert len(sentences) > 15 and {part for part in parts if part not in source} == PUT_TOGETHER
    sketcher = graph.start("sketcher").ready()
    graph.publisher(String, "/sensor")              # not latched
    graph.latched("/sensor").publish(String(data=DESCRIPTION))
    graph.node.create_publisher(Image, "/gates", QoSProfile(depth=9, reliability=ReliabilityPolicy.BEST_EFFORT))
    for said in ("QoS.*DURABILITY", "QoS.*RELIABILITY", "sensor on /sensor: 32 × 32 pixels, 153 bins of 250 ps"):
        graph.wait(lambda said=said: re.search(said, sketcher.text), said)
