"""The commands and the code of every page run, where the files are that pages take as given; the quick start's in full.

Nodes are started of docs/quickstart.md and docs/motion.md; those of other pages: test_pages.py.
"""

import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.cli import main
from srt3d_ros.datasets import open_sensor, photon_file, read
from srt3d_ros.messages import cdr
from srt3d_ros.messages import points as points_message
from srt3d_ros.recording.reader import RecordingReader
from tests.bags import IMAGE, TEXT, write_bag
from tests.nodes.conftest import Graph
from tests.processes import Process

from .conftest import HEAD, HOT, TRUE
from .pages import PAGES, ROOT, command_lines, fenced, indented, inline, section

FILES, NODES = {"info", "convert", "reconstruct", "evaluate", "review"}, {"up", "node", "play"}
NOT_HERE = {"srt3d evaluate --out eval",            # too long, or without a GPU
            "srt3d evaluate --ppp 1 3 10 30 100 300 1000 --sketch-size 5 10 20 --out eval",
            "srt3d reconstruct simulator -o head.png --device cuda"}
ELSEWHERE = ("IncludeLaunchDescription", "my_sensor.json")      # code of test_launch.py, and of the quick start
QUICKSTART = PAGES["docs/quickstart.md"]
DRIVER, OF_HISTOGRAMS = "examples/spad_driver.py", "examples/histogram_driver.py"


@pytest.fixture
def graph(ros):
    graph = Graph("/")
    yield graph
    graph.close()


def run(page: str) -> None:
    """Run the Python of a page, then its commands that take files."""
    events, _ = HEAD.frame(0)
    row, col = np.divmod(events.pixel, 141)
    cube = np.random.default_rng(0).poisson(0.01, (24, 20, 4613)).astype(np.uint8)
    if page == "docs/api.md":               # which takes a window of 100 pixels
        photon_file.save("head.npz", HEAD.sensor, events)
    names = {"row": row, "col": col, "toa": events.toa, "irf": HEAD.sensor.irf, "cube": cube}
    for block in fenced(PAGES[page], "python"):
        if not any(word in block for word in ELSEWHERE):
            exec(block, names)
            assert "cloud" not in names or len(names["cloud"]) > 400
    for line in command_lines(PAGES[page]):
        if line[0] == "srt3d" and line[1] in FILES and " ".join(line) not in NOT_HERE:
            assert main.main(line[1:]) == 0, line


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"docs/calibration.md"}))
def test_the_commands_and_the_code_of_a_page_run(graph, here, page):
    run(page)
    if page in ("docs/quickstart.md", "docs/motion.md"):
        lines = [["srt3d", "node", *line[3:]] if line[:3] == ["ros2", "run", "srt3d_ros"] else line
                 for line in command_lines(PAGES[page])]        # ros2 run is not among the wheels
        graph.processes += [Process(line) for line in lines if line[0] == "srt3d" and line[1] in NODES]
        for node in graph.processes:
            assert node.ready().end(signal.SIGINT) == 0 and "Traceback" not in node.text, node.text


def test_the_calibration_finds_what_the_sensor_is(here):
    run("docs/calibration.md")
    found = read("calibrated.npz").sensor
    used = found.mask
    assert np.flatnonzero(~used).tolist() == np.sort(HOT).tolist()
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


def terminal(lines: str) -> Process:
    """A shell in which the lines are typed; what signals reach is the last line's program."""
    *before, last = [line for line in lines.splitlines() if line.strip()]
    return Process(["bash", "-ec", "\n".join([*before, f"exec {last}"])])


def typed(step: str, text: str) -> str:
    """The indented block of a step that has this text."""
    (block,) = [block for block in indented(section(QUICKSTART, step)) if text in block]
    return block


def ranges_m(cloud: PointCloud2) -> np.ndarray:
    return np.linalg.norm(points_message.decode_cdr(serialize_message(cloud))[1]["xyz"], axis=1)


def test_the_camera_from_the_description_to_the_measured_irf(graph, here):
    (here / "my_sensor.json").write_text(fenced(section(QUICKSTART, "1."), "json")[0])
    check = terminal(typed("1.", "open_sensor"))
    assert check.code() == 0 and " ".join(check.text.split()) in inline(section(QUICKSTART, "1.")), check.text
    (here / "run.rrd").unlink()
    clouds = graph.collect(PointCloud2, "/points")
    driver, up = (terminal(typed("3.", text)) for text in (DRIVER, "srt3d up"))
    graph.processes += [driver, up]
    up.says("recording to")
    before = len(clouds)
    graph.wait(lambda: len(clouds) > before + 3, "clouds")
    assert up.end(signal.SIGINT) == 0 and len(RecordingReader(Path("run.rrd")).cloud_index()), up.text
    assert typed("4.", "ros2 bag record").split()[3:] == ["-o", "wall", "/gates", "/sensor"]     # has no wheel
    frames, described = graph.collect(Image, "/gates", raw=True), graph.collect_latched(String, "/sensor")
    graph.wait(lambda: len(frames) > 60 and described, "more frames than the page reads")
    write_bag(here / "wall", [("/sensor", TEXT, cdr.write_text(described[0].data)),
                              *(("/gates", IMAGE, raw) for raw in frames)])
    assert driver.end(signal.SIGINT) == 0, driver.text
    assert not any("Traceback" in one.text for one in (up, driver))
    range_said, bin_said = map(float, re.search(r"are ([\d.]+) m away, which\s+is bin (\d+)", QUICKSTART).groups())
    off_m = ranges_m(clouds[-1]) - range_said
    assert len(off_m) > 0.9 * 32 * 32 and abs(np.median(off_m)) < 0.01 and np.percentile(np.abs(off_m), 95) < 0.05
    assert range_said == pytest.approx(bin_said * 250e-12 * 299_792_458 / 2, abs=0.005)
    step = section(QUICKSTART, "4.")
    found = [float(value) for value in re.search(r"finds ((?:[\d.]+, )+[\d.]+\d)", step)[1].split(", ")]
    exec(fenced(step, "python")[0], {})
    sensor = json.loads(Path("my_sensor.json").read_text())
    assert sensor["irf"][sensor["irf_ref"] - len(found) // 2:][:len(found)] == pytest.approx(found, abs=0.01)
    assert open_sensor("my_sensor.json").irf_ref == sensor["irf_ref"]


def test_the_driver_of_histograms_gives_clouds_where_the_page_says(graph, here):
    clouds = graph.collect(PointCloud2, "/points")
    graph.processes += [terminal(f"python {OF_HISTOGRAMS}"), terminal("srt3d up")]
    graph.wait(lambda: len(clouds) > 3, "clouds")
    range_m = ranges_m(clouds[-1])
    assert len(range_m) > 0.9 * 32 * 48
    assert np.abs(np.median(range_m) - float(re.search(r"scene is ([\d.]+) m away", QUICKSTART)[1])) < 0.01


@pytest.mark.parametrize("driver", [DRIVER, OF_HISTOGRAMS])
def test_the_drivers_are_forty_lines_without_this_package(driver):
    text = (ROOT / driver).read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) <= 40
    assert "srt3d_ros" not in re.sub('""".*?"""', "", text)
