"""`srt3d demo`, as `make demo` runs it, with real nodes in processes."""

import json
import os
import signal
import sys

import psutil
import pytest

from srt3d_ros.cli import main
from tools.processes import DEADLINE_S, nodes_of, wait

NODES = {"player", "sketcher", "reconstructor", "recorder"}


@pytest.fixture
def start(tmp_path, repository):
    """Starts `srt3d demo` with its output in out.txt, and ends it and its nodes after the test."""
    started = []

    def start(*options) -> psutil.Popen:
        command = [sys.executable, "-m", "srt3d_ros.cli.main", "demo", "--out", str(tmp_path / "out"), *options]
        with (tmp_path / "out.txt").open("wb") as output:
            started.append(psutil.Popen(command, cwd=repository, stdout=output, stderr=output))
        return started[-1]

    yield start
    for process in started:
        if process.is_running():
            process.send_signal(signal.SIGINT)
            process.wait(DEADLINE_S)


def test_the_moving_scene_goes_through_all_nodes_and_is_compared_with_the_truth_of_the_same_moment(start, tmp_path):
    demo = start("--rate-hz", "2", "--duration-s", "2")
    assert demo.wait(DEADLINE_S) == 0, (tmp_path / "out.txt").read_text()
    out = tmp_path / "out"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames_sent"] == 4 == summary["frames"] == summary["frames_judged"] and summary["frames_lost"] == 0
    assert summary["true_detections_percent"] > 95 and summary["dae_mm"] < 6
    assert {path.name for path in out.iterdir()} == {"recording.rrd", "cloud.png", "summary.json", "nodes.log"}
    assert (out / "cloud.png").read_bytes()[1:4] == b"PNG" and (out / "recording.rrd").read_bytes()[:3] == b"RRF"
    assert f"  frames sent               {summary['frames_sent']}\n" in (tmp_path / "out.txt").read_text()


def test_ctrl_c_ends_the_demo_and_its_nodes_quietly(start, tmp_path):
    demo = start("--duration-s", "60")
    said = tmp_path / "out.txt"
    wait(lambda: len(nodes_of(demo.pid)) == len(NODES), "the nodes", said.read_text)
    nodes = nodes_of(demo.pid)
    assert set(nodes) == NODES
    demo.send_signal(signal.SIGINT)
    assert demo.wait(DEADLINE_S) == 130
    # The kernel ends a player that was just starting, after the demo has ended.
    wait(lambda: not any(node.is_running() for node in nodes.values()), "the nodes' end")
    assert "Traceback" not in said.read_text()


@pytest.mark.parametrize("options, said", [
    (["--rate-hz", "0"], "--rate-hz is 0.0: expected a rate above 0"),
    (["--duration-s", "0"], "--duration-s is 0.0: expected time for 1 to"),
])
def test_what_cannot_be_played_is_refused_before_anything_starts(tmp_path, capsys, options, said):
    assert main.main(["demo", "--out", str(tmp_path / "out"), *options]) == 2
    assert capsys.readouterr().err.startswith(f"srt3d: error: {said}") and not os.listdir(tmp_path)
