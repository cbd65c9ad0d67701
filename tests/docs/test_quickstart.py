"""docs/quickstart.md does what it says: its own blocks are run, from the description to the measured IRF."""

import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from srt3d_ros.datasets import open_sensor
from srt3d_ros.messages import points as points_message
from srt3d_ros.recording.reader import RecordingReader
from tests.nodes.conftest import Graph
from tests.processes import Process

from .pages import PAGES, ROOT, SOURCE, fenced, indented, inline, section

PAGE, TROUBLES = PAGES["docs/quickstart.md"], PAGES["docs/troubleshooting.md"]
DRIVER, OF_HISTOGRAMS = "examples/spad_driver.py", "examples/histogram_driver.py"
VARIABLE = (r'…|[\d.]+|/\w+|"\w+"|[:,;()]|\b(is|are|of|on|expected|no_sensor|malformed|queue|my_sensor.json)\b')
PUT_TOGETHER = {"waiting for a sensor description", "waiting for a frame"}      # of words


@pytest.fixture
def graph(ros):
    graph = Graph("/")
    yield graph
    graph.close()


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


def test_the_camera_from_the_description_to_the_measured_irf(graph, here):
    (here / "my_sensor.json").write_text(fenced(section(PAGE, "1."), "json")[0])
    check = terminal(typed("1.", "open_sensor"))
    assert check.code() == 0 and " ".join(check.text.split()) in inline(section(PAGE, "1.")), check.text
    (here / "run.rrd").unlink()
    clouds = graph.collect(PointCloud2, "/points")
    driver, up = (terminal(typed("3.", text)) for text in (DRIVER, "srt3d up"))
    graph.processes += [driver, up]
    up.says("recording to")
    before = len(clouds)
    graph.wait(lambda: len(clouds) > before + 3, "clouds")
    assert up.end(signal.SIGINT) == 0 and len(RecordingReader(Path("run.rrd")).cloud_index()), up.text
    bag = terminal(typed("4.", "bag-record"))
    graph.processes.append(bag)
    graph.wait(lambda: graph.total("bag_recorder", "frames_out") > 60, "more frames in the bag than the page reads")
    assert bag.end(signal.SIGINT) == driver.end(signal.SIGINT) == 0, (bag.text, driver.text)
    assert not any("Traceback" in one.text for one in (up, bag, driver))
    range_said, bin_said = map(float, re.search(r"are ([\d.]+) m away, which\s+is bin (\d+)", PAGE).groups())
    off_m = ranges_m(clouds[-1]) - range_said
    assert len(off_m) > 0.9 * 32 * 32 and abs(np.median(off_m)) < 0.01 and np.percentile(np.abs(off_m), 95) < 0.05
    assert range_said == pytest.approx(bin_said * 250e-12 * 299_792_458 / 2, abs=0.005)
    found = [float(value) for value in re.search(r"finds ((?:[\d.]+, )+[\d.]+\d)", section(PAGE, "4."))[1].split(", ")]
    exec(fenced(section(PAGE, "4."), "python")[0], {})
    sensor = json.loads(Path("my_sensor.json").read_text())
    assert sensor["irf"][sensor["irf_ref"] - len(found) // 2:][:len(found)] == pytest.approx(found, abs=0.01)
    assert open_sensor("my_sensor.json").irf_ref == sensor["irf_ref"]


def test_the_driver_of_histograms_gives_clouds_where_the_page_says(graph, here):
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


def test_the_tables_of_troubles_quote_the_source():
    """tests/nodes has the causes: silence, clocks, contradictions, bad messages, losses, overload."""
    source = re.sub(r'"\s*\n\s*f?"', "", SOURCE)          # literals of several lines
    quoted = [code for code in inline(TROUBLES) if len(code.split()) > 2 and not code.startswith(("ros2", "srt3d"))]
    parts = {part.strip() for message in quoted for part in re.sub(VARIABLE, "\n", message).splitlines()}
    assert len(quoted) > 15 and {part for part in parts if part not in source} == PUT_TOGETHER
