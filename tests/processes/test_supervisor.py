"""`srt3d up` as the parent of its nodes: processes of their own, watched, started again, ended in order."""

import re
import signal
import sys

import psutil
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.processes import supervisor
from srt3d_ros.processes.node_command import NODES
from srt3d_ros.processes.supervisor import END, GIVE_UP, MOST_RESTARTS, RESTART, Restarts
from tests.nodes.conftest import events, photon_file, sensor  # noqa: F401
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


def kill(up: Process, name: str, times: int = 1) -> None:
    """Kill a node, and the processes that replace it."""
    killed = set()
    for _ in range(times):
        node = wait(lambda: (found := nodes_of(up.pid).get(name)) not in killed and found, f"{name} of {up.text}")
        node.kill()
        killed.add(node)


def runs(node: psutil.Process) -> bool:
    return node.is_running() and node.status() != psutil.STATUS_ZOMBIE


def test_the_nodes_end_from_the_source_to_the_recorder_and_the_recording_is_whole(start, photon_file, tmp_path):  # noqa: F811
    recording = tmp_path / "run.rrd"
    up = start(UP, "--input", photon_file, "--record", recording, "--namespace", "front", "-r", "points:=/robot/cloud")
    up.says("starts /front/player, /front/sketcher, /front/reconstructor, /front/recorder; Ctrl-C stops them")
    up.says(f"[front.recorder]: recording to {recording}")
    for name in ("player", "sketcher", "reconstructor"):
        up.says(f"[front.{name}]: ready")
    assert up.end(signal.SIGINT) == 0, up.text
    order = ["player", "sketcher", "reconstructor", "recorder"]
    assert re.findall(r"\[front\.(\w+)\]: shutting down", up.text) == order
    assert RrdReader(recording).recordings()


@pytest.mark.parametrize("name", NODES)
def test_a_node_is_started_again_five_times_in_a_minute_and_only_a_player_five_times_in_all(name, monkeypatch):
    end = GIVE_UP if name == "recorder" else END
    restarts = Restarts(NODES)
    steps = [restarts.after(name, -signal.SIGSEGV) for _ in range(MOST_RESTARTS + 1)]
    assert steps == [*MOST_RESTARTS * [RESTART], end]
    assert restarts.after("another", 1) == RESTART
    monkeypatch.setattr(supervisor, "BUDGET_S", 0.0)
    later = {restarts.after(name, 1) for _ in range(3 * MOST_RESTARTS)}
    assert later == {END if name == "player" else RESTART}


@pytest.mark.parametrize("name, code, names, step", [
    ("player", 0, NODES, END), ("player", 3, NODES, END), ("sketcher", 2, NODES, END), ("sketcher", 0, NODES, RESTART),
    ("recorder", 2, ("recorder", "sketcher"), GIVE_UP), ("recorder", 2, NODES, END)])
def test_what_a_restart_does_not_help_is_not_started_again(name, code, names, step):
    assert Restarts(names).after(name, code) == step


def test_points_go_on_without_a_recorder_that_keeps_dying_and_the_exit_code_says_so(start, tmp_path):
    up = start(UP, "--record", tmp_path / "a.rrd", "-p", "sketcher.autostart:=false")
    kill(up, "sketcher")
    up.says("srt3d up: sketcher was killed by SIGKILL: starting it again, at most 5 times in 60 s")
    kill(up, "recorder", MOST_RESTARTS + 1)
    up.says("srt3d up: ERROR: recorder was killed by SIGKILL: given up, nothing is recorded; points go on")
    up.says("[sketcher]: unconfigured")
    assert set(nodes_of(up.pid)) == {"sketcher", "reconstructor"}
    assert up.end(signal.SIGINT) == 128 + signal.SIGKILL, up.text


def test_a_recording_that_stopped_is_seen_in_the_exit_code(start, photon_file, tmp_path):  # noqa: F811
    recording = tmp_path / "run.rrd"
    up = start(UP, "--input", photon_file, "--record", recording).says("recording to")
    wait(lambda: recording.unlink(missing_ok=True) or "stopped, as the file is gone" in up.text, "the recording's end")
    assert up.end(signal.SIGINT) == 1, up.text


def test_no_node_outlives_a_killed_parent(start, photon_file):  # noqa: F811
    up = start(UP, "--input", photon_file).says("[player]: ready")
    nodes = nodes_of(up.pid)
    assert set(nodes) == {"player", "sketcher", "reconstructor"}
    up.kill()
    wait(lambda: not any(map(runs, nodes.values())), "the end of the nodes")


@pytest.mark.parametrize("file, code", [("", 0), ("no such file.npz", 2)])
def test_a_player_that_ends_or_cannot_start_ends_all_with_its_code(start, photon_file, file, code):  # noqa: F811
    up = start(UP, "--input", file or photon_file, "-p", "player.frames:=2")
    assert up.code() == code and (not file or "srt3d: error: no such file.npz: no such file." in up.lines)
    assert f"srt3d up: player ended with exit code {code}: stopping all nodes" in up.lines
