"""The code and the commands of every page run, in a folder with the files that they read.

Real nodes run only for the camera of the quick start; test_pages.py checks the options and parameters of all others.
"""

import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

import srt3d_ros
from srt3d_ros import read
from srt3d_ros.cli import main
from srt3d_ros.datasets import open_sensor
from srt3d_ros.messages import points_message
from srt3d_ros.recording.reader import RecordingReader
from tests.nodes.conftest import Graph
from tools.processes import Process

from .conftest import HEAD, HOT, TRUE
from .pages import PAGES, ROOT, command_lines, fenced, indented, inline, section

LONG = r"evaluate (?!examples/head.npz --methods)|--device cuda"
ELSEWHERE = ("IncludeLaunchDescription", "my_sensor.json")      # a launch file; run by the test of the quick start
QUICKSTART = PAGES["docs/quickstart.md"]
ran: set[str] = set()       # commands that pages have run


@pytest.fixture
def graph(ros):
    graph = Graph("/")
    yield graph
    graph.close()


def run(page: str) -> None:
    """Run the Python of a page, then its commands on files, except long ones and those of earlier pages."""
    events, _ = HEAD.frame(0)
    row, col = np.divmod(events.pixel, 141)
    cube = np.random.default_rng(0).poisson(0.01, (24, 20, 4613)).astype(np.uint8)
    names = {"row": row, "col": col, "toa": events.toa, "irf": HEAD.sensor.irf, "cube": cube}
    for block in fenced(PAGES[page], "python"):
        if not any(word in block for word in ELSEWHERE):
            exec(block, names)
            assert "cloud" not in names or len(names["cloud"]) > 400
    for line in map(" ".join, command_lines(PAGES[page])):
        if re.match("srt3d (info|inspect|reconstruct|evaluate|review) ", line):
            read_files = re.findall(r"(?<!-o )(?<!--out )\b\w+\.(?:npz|ptu|mat|rrd)\b", line)
            assert [name for name in read_files if not Path(name).exists()] == []
            if not re.search(LONG, line) and line not in ran:
                assert main.main(line.split()[1:]) == 0, line
                ran.add(line)


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"docs/calibration.md"}))
def test_the_commands_and_the_code_of_a_page_run(here, page):
    run(page)


def test_the_calibration_finds_what_the_sensor_is(here):
    run("docs/calibration.md")
    found = read("calibrated.npz").sensor
    used = found.mask
    assert np.flatnonzero(~used).tolist() == HOT.tolist()
    gain, late = found.gain[used] / TRUE.gain[used], (found.delay_bins - TRUE.delay_bins)[used]
    assert (gain / gain.mean()).std() < 0.04 and np.abs(late).mean() < 0.3
    assert np.abs(np.cumsum(found.background_shape) - np.cumsum(TRUE.background_shape)).max() < 0.03


def test_the_notebook_prints_what_is_stored(here, capsys):
    names: dict = {}
    for cell in json.loads((ROOT / "docs/arrays.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            stored = ["".join(one["text"]) for one in cell["outputs"] if one.get("name") == "stdout"]
            assert capsys.readouterr().out == "".join(stored)


def terminal(step: str, text: str) -> Process:
    """Run the block of a step that has this text in a shell; signals reach the program of its last line."""
    (block,) = [block for block in indented(section(QUICKSTART, step)) if text in block]
    *before, last = block.splitlines()
    return Process(["bash", "-ec", "\n".join([*before, f"exec {last}"])])


def numbers(pattern: str) -> list[float]:
    """The numbers in the quick start that match a pattern."""
    return [float(number) for group in re.search(pattern, QUICKSTART).groups() for number in group.split(", ")]


def test_the_camera_from_the_description_to_the_measured_irf(graph, here):
    (here / "my_sensor.json").write_text(fenced(section(QUICKSTART, "1."), "json")[0])
    check = terminal("1.", "open_sensor")
    assert check.code() == 0 and " ".join(check.text.split()) in inline(section(QUICKSTART, "1.")), check.text
    (here / "run.rrd").unlink()
    clouds = graph.collect(PointCloud2, "/points")
    up = terminal("3.", "srt3d up").says("[sketcher]: ready").says("[reconstructor]: ready")
    driver = terminal("3.", "python")       # last: it keeps a processor busy
    graph.processes += [driver, up]
    driver.says("publishing gates, ")
    up.says("recording to")
    before = len(clouds)
    graph.wait(lambda: len(clouds) > before + 3, "clouds")
    assert up.end(signal.SIGINT) == 0 and len(RecordingReader(Path("run.rrd")).index), up.text
    assert driver.end(signal.SIGINT) == 0 and not any("Traceback" in one.text for one in (up, driver)), driver.text
    (command,) = [line for line in inline(section(QUICKSTART, "4.")) if "spad_driver" in line]
    graph.processes.append(Process(command.split()))
    graph.processes.append(recorder := terminal("4.", "record_bag"))
    assert recorder.code() == 0, recorder.text
    range_named, bin_named = numbers(r"wall is ([\d.]+) m away, which\s+is\s+bin (\d+)")
    range_m = np.linalg.norm(points_message.decode_cdr(serialize_message(clouds[-1]))[1]["xyz"], axis=1)
    off_m, is_wall = range_m - range_named, range_m > 2.7
    assert len(off_m) > 0.9 * 32 * 32 and abs(np.median(off_m[is_wall])) < 0.01 and np.abs(off_m[is_wall]).mean() < 0.02
    assert 0.3 < is_wall.mean() < 0.8 and ((range_m > 2.2) & (range_m < 2.6)).sum() > 0.95 * (~is_wall).sum()
    assert range_named == pytest.approx(bin_named * 250e-12 * 299_792_458 / 2, abs=0.005)
    found = numbers(r"finds ((?:[\d.]+, )+[\d.]+\d)")
    exec(fenced(section(QUICKSTART, "4."), "python")[0], {})
    sensor = json.loads(Path("my_sensor.json").read_text())
    assert sensor["irf"][sensor["irf_ref"] - len(found) // 2:][:len(found)] == pytest.approx(found, abs=0.01)
    assert open_sensor("my_sensor.json").irf_ref == sensor["irf_ref"]


def test_the_driver_of_histograms_sees_the_scene_where_the_page_says(graph, here):
    graph.processes.append(Process(["python", "examples/histogram_driver.py"]))
    command = ["python", "examples/record_bag.py", "zones", "/histograms", "/sensor", "--seconds", "0"]
    graph.processes.append(recorder := Process(command))
    assert recorder.code() == 0, recorder.text
    cloud = srt3d_ros.reconstruct("zones")
    assert len(cloud) > 0.9 * 32 * 48
    assert abs(np.nanmedian(cloud.range_image()) - numbers(r"scene is ([\d.]+) m away")[0]) < 0.01
