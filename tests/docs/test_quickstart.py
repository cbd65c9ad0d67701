"""docs/quickstart-driver.md does what it says: its own blocks are run, from the description to the measured IRF."""

import json
import re
import shlex
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from srt3d_ros.datasets import open_sensor
from srt3d_ros.messages import points as points_message
from srt3d_ros.recording.reader import RecordingReader
from tests.docs import pages
from tests.nodes.conftest import Graph
from tests.processes import Process

PAGE = "docs/quickstart-driver.md"
DRIVER, OF_HISTOGRAMS = "examples/spad_driver.py", "examples/histogram_driver.py"
COMPILE_S = 900.0       # on a slow machine with other work, once
RECORDED = 60           # messages: more than the snippet of the page reads


@pytest.fixture(scope="module")
def page(repository) -> str:
    return (repository / PAGE).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def checkout(repository, page, tmp_path_factory) -> Path:
    """What steps 1 and 2 leave: the files that the page names, and `python` and `srt3d` for its terminals."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("config", "examples"):
        (folder / name).symlink_to(repository / name)
    (folder / "bin").mkdir()
    for name, module in (("python", ""), ("srt3d", "-m srt3d_ros.cli.main")):
        program = folder / "bin" / name
        program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {module} "$@"\n')
        program.chmod(0o755)
    (folder / "my_sensor.json").write_text(pages.fenced(pages.section(page, "^2"), "json")[0])
    return folder


def terminal(folder: Path, typed: str) -> Process:
    """A shell in this folder in which the lines are typed; what signals reach is the last line's program."""
    *before, last = [line for line in typed.splitlines() if line.strip()]
    path = f"PATH={shlex.quote(str(folder / 'bin'))}:$PATH"
    return Process(["bash", "-ec", "\n".join([f"cd {shlex.quote(str(folder))}", path, *before, f"exec {last}"])])


def typed(page: str, step: str, text: str) -> str:
    """The indented block of a step that has this text."""
    (block,) = [block for block in pages.indented(pages.section(page, f"^{step}")) if text in block]
    return block


def ranges_m(cloud: PointCloud2) -> np.ndarray:
    return np.linalg.norm(points_message.decode_cdr(serialize_message(cloud))[1]["xyz"], axis=1)


def test_step_2_checks_the_description_as_shown(page, checkout):
    check = terminal(checkout, typed(page, "2", "open_sensor"))
    assert check.code() == 0, check.text
    assert " ".join(check.text.split()) in pages.inline(pages.section(page, "^2"))


@pytest.mark.parametrize("driver", [DRIVER, OF_HISTOGRAMS])
def test_the_drivers_of_step_3_are_forty_lines_without_this_package(repository, driver):
    text = (repository / driver).read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) <= 40
    assert "srt3d_ros" not in re.sub('""".*?"""', "", text)


@pytest.fixture(scope="module")
def cloud(ros, page, checkout):
    """The last cloud of step 4, after step 1 (what of it needs no network) and with the bag of step 5."""
    compiled = terminal(checkout, next(line for line in typed(page, "1", "compile").splitlines() if "compile" in line))
    assert compiled.code(COMPILE_S) == 0, compiled.text
    graph = Graph("/")
    clouds = graph.collect(PointCloud2, "/points")
    try:
        driver, up = (terminal(checkout, typed(page, "4", text)) for text in (DRIVER, "srt3d up"))
        graph.processes += [driver, up]
        up.says("recording to")
        before = len(clouds)
        graph.wait(lambda: len(clouds) > before + 3, "clouds")
        up.end(signal.SIGINT)
        bag = terminal(checkout, typed(page, "5", "bag-record"))
        graph.processes.append(bag)
        graph.wait(lambda: graph.total("bag_recorder", "frames_out") > RECORDED, "a second of frames in the bag")
        assert bag.end(signal.SIGINT) == 0, bag.text
        driver.end(signal.SIGINT)
    finally:
        graph.close()
    assert all(name in up.text for name in ("/sketcher", "/reconstructor", "/recorder"))
    for process in (up, driver):
        assert process.returncode == 0 and "Traceback" not in process.text, process.text
    yield clouds[-1]
    shutil.rmtree(checkout / "wall", ignore_errors=True)        # as much as 1 GB


def test_step_4_gives_clouds_where_the_page_says_and_records_them(cloud, page, checkout):
    range_said, bin_said = re.search(r"points are all ([\d.]+) m\s+away, which is bin (\d+)", page).groups()
    range_m = ranges_m(cloud)
    assert cloud.header.frame_id == "spad_optical" and len(range_m) > 0.9 * 32 * 32
    assert np.median(range_m) == pytest.approx(float(range_said), abs=0.01)
    assert np.percentile(np.abs(range_m - float(range_said)), 95) < 0.05
    assert float(range_said) == pytest.approx(int(bin_said) * 250e-12 * 299_792_458 / 2, abs=0.005)
    assert len(RecordingReader(checkout / "run.rrd").cloud_index())


def test_step_5_finds_the_impulse_response_that_the_page_says(cloud, page, checkout, monkeypatch):
    step = pages.section(page, "^5")
    found = [float(value) for value in re.search(r"finds ((?:[\d.]+, )+[\d.]+\d)", step)[1].split(", ")]
    monkeypatch.chdir(checkout)
    exec(pages.fenced(step, "python")[0], {})
    sensor = json.loads(Path("my_sensor.json").read_text())
    assert sensor["irf"][sensor["irf_ref"] - len(found) // 2:][:len(found)] == pytest.approx(found, abs=0.01)
    assert open_sensor("my_sensor.json").irf_ref == sensor["irf_ref"]


def test_the_driver_of_histograms_gives_clouds_where_the_page_says(ros, page, checkout):
    graph = Graph("/")
    clouds = graph.collect(PointCloud2, "/points")
    try:
        driver, up = terminal(checkout, f"python {OF_HISTOGRAMS}"), terminal(checkout, "srt3d up")
        graph.processes += [driver, up]
        graph.wait(lambda: len(clouds) > 3, "clouds")
        assert up.end(signal.SIGINT) == 0 and driver.end(signal.SIGINT) == 0, (up.text, driver.text)
    finally:
        graph.close()
    bullet, = (text for text in page.split("\n* ") if OF_HISTOGRAMS in text)
    range_m = ranges_m(clouds[-1])
    assert len(range_m) > 0.9 * 32 * 48
    assert np.abs(np.median(range_m) - float(re.search(r"is\s+([\d.]+) m away", bullet)[1])) < 0.01
