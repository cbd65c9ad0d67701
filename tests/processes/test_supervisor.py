"""`srt3d up` as the parent of its nodes: processes of their own, watched, ended in order."""

import re
import signal
import sys

import psutil
import pytest
from rerun.chunk import RrdReader

from tools.processes import Process, nodes_of, wait

UP = [sys.executable, "-m", "srt3d_ros.cli.main", "up"]


@pytest.fixture
def start():
    """Starts a command, and ends it with the test."""
    started = []

    def start(command: list[str], *options: object) -> Process:
        started.append(Process([*command, *map(str, options)]))
        return started[-1]

    yield start
    for process in started:
        process.stop()


def runs(node: psutil.Process) -> bool:
    return node.is_running() and node.status() != psutil.STATUS_ZOMBIE


def test_the_nodes_end_from_the_source_to_the_recorder_and_the_recording_is_whole(start, tmp_path):
    recording = tmp_path / "run.rrd"
    up = start(UP, "--input", "simulator", "--record", recording, "--namespace", "front", "-r", "points:=/robot/cloud")
    up.says("starts /front/player, /front/sketcher, /front/reconstructor, /front/recorder; Ctrl-C stops them")
    up.says(f"[front.recorder]: recording to {recording}")
    for name in ("player", "sketcher", "reconstructor"):
        up.says(f"[front.{name}]: ready")
    assert up.end(signal.SIGINT) == 0, up.text
    order = ["player", "sketcher", "reconstructor", "recorder"]
    assert re.findall(r"\[front\.(\w+)\]: shutting down", up.text) == order
    assert RrdReader(recording).recordings()


def test_a_recording_that_stopped_is_seen_in_the_exit_code(start, tmp_path):
    recording = tmp_path / "run.rrd"
    up = start(UP, "--input", "simulator", "--record", recording).says("recording to")
    wait(lambda: recording.unlink(missing_ok=True) or "stopped, as the file is gone" in up.text, "the recording's end")
    assert up.end(signal.SIGINT) == 1, up.text


def test_a_node_that_dies_ends_all(start):
    up = start(UP, "-p", "sketcher.autostart:=false").says("unconfigured")
    nodes_of(up.pid)["sketcher"].kill()
    assert up.code() == 128 + signal.SIGKILL
    assert "srt3d up: sketcher was killed by SIGKILL: stopping all nodes" in up.lines


def test_no_node_outlives_a_killed_parent(start):
    up = start(UP, "--input", "simulator").says("[player]: ready")
    nodes = nodes_of(up.pid)
    assert set(nodes) == {"player", "sketcher", "reconstructor"}
    up.kill()
    wait(lambda: not any(map(runs, nodes.values())), "the end of the nodes")


@pytest.mark.parametrize("options, code, line", [
    (["--input", "simulator", "-p", "player.frames:=2"], 0, ""),
    (["--input", "no such file.npz"], 2,
     "srt3d: error: no such file.npz: no such file.")])
def test_a_player_that_ends_or_cannot_start_ends_all_with_its_code(start, options, code, line):
    up = start(UP, *options)
    assert up.code() == code and (not line or line in up.lines)
    assert f"srt3d up: player ended with exit code {code}: stopping all nodes" in up.lines
