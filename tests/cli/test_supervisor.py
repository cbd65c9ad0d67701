"""`srt3d up` as the parent of its nodes: processes of their own, started again when they die, ended in order."""

import signal
import sys

import psutil
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.processes import Process, wait
from tests.programs import nodes_of

UP = [sys.executable, "-m", "srt3d_ros.cli.main", "up"]
IMPATIENT = [sys.executable, "-c", """if True:
    import sys
    from srt3d_ros.cli import main, supervisor
    supervisor.FIRST_DELAY_S, supervisor.MOST_RESTARTS = 0.01, 1
    sys.exit(main.main(["up", *sys.argv[1:]]))"""]


def port_of(node: psutil.Process) -> str:
    """The lock of the shared memory where it reads data: the last of its domain's ports, not those from 7000 on."""
    return max((file.path for file in node.open_files() if "_port" in file.path), key=lambda path: (len(path), path))


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
    up.says("recording to").says("health")
    nodes, order = nodes_of(up.pid), []
    up.send(signal.SIGINT)
    while len(order) < len(nodes):
        order += [name for name, node in nodes.items() if name not in order and not runs(node)]
    assert up.code() == 0, up.text
    assert order == ["player", "sketcher", "reconstructor", "recorder"]
    assert "[recorder] [INFO]" in up.text and f"recording to {recording}" in up.text
    assert all(f"  /front/{name}" in up.lines for name in order)
    assert "    out  /robot/cloud  /front/depth" in up.text and "ros2 topic hz /robot/cloud" in up.text
    (line,) = [line for line in up.lines if "computing on" in line] or [""]
    assert line.startswith("[reconstructor] ") and "[front.reconstructor]: " in line or not line
    assert RrdReader(recording).recordings()


def test_a_node_that_dies_is_started_again_until_it_dies_too_often(start):
    up = start(IMPATIENT, "-p", "sketcher.autostart:=false").says("(unconfigured)")
    first = nodes_of(up.pid)
    first["sketcher"].kill()
    up.says("srt3d up: sketcher was killed by SIGKILL: it is started again in 0 s (1 of 1)")
    wait(lambda: nodes_of(up.pid).get("sketcher", first["sketcher"]) != first["sketcher"], "another", lambda: up.text)
    second = nodes_of(up.pid)
    assert second["reconstructor"] == first["reconstructor"]
    second["sketcher"].kill()
    assert up.code() == 128 + signal.SIGKILL
    assert "srt3d up: sketcher was killed by SIGKILL; it died 2 times within 60 s: ending all nodes" in up.lines


def test_a_recorder_that_is_started_again_keeps_what_was_recorded_and_no_node_outlives_a_killed_parent(start, tmp_path):
    up = start(UP, "--input", "simulator", "--record", tmp_path / "run.rrd", "--bag", tmp_path / "rec")
    up.says(f"recording to {tmp_path / 'run.rrd'}")
    wait(lambda: (tmp_path / "run.rrd").exists() and (tmp_path / "rec").exists(), "the files", lambda: up.text)
    killed = nodes_of(up.pid)["recorder"]
    port = port_of(killed)
    killed.kill()
    up.says(f"recording to {tmp_path / 'run_2.rrd'}")
    assert port != port_of(nodes_of(up.pid)["recorder"])        # or it may hear nothing: nodes/transport.py
    nodes_of(up.pid)["bag_recorder"].kill()
    wait((tmp_path / "rec_2").exists, "another bag", lambda: up.text)
    assert {"run.rrd", "run_2.rrd", "rec", "rec_2"} <= {path.name for path in tmp_path.iterdir()}
    nodes = nodes_of(up.pid)
    assert set(nodes) == {"player", "sketcher", "reconstructor", "recorder", "bag_recorder"}
    up.kill()
    wait(lambda: not any(map(runs, nodes.values())), "the end of the nodes")


def test_a_node_that_cannot_start_ends_all_with_its_line_and_code(start):
    up = start(UP, "--input", "no such file.npz")
    assert up.code() == 2
    assert "[player] photon file is no such file.npz: expected a file that exists" in up.lines
    assert "srt3d up: player did not start: it ended with exit code 2: ending all nodes" in up.lines


def test_a_player_at_its_end_is_no_failure(start):
    up = start(UP, "--input", "simulator", "-p", "player.frames:=2", "-p", "player.wait_for_subscribers:=0")
    assert up.code() == 0
    assert "srt3d up: player is done: ending all nodes" in up.lines
