"""`srt3d view`: the viewer where there is a screen, else words that lead to one; and what recorders and it serve."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import psutil
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.cli import main
from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.writer import RecordingWriter

TIMEOUT_S, VIEWER_S = 60.0, 10.0
HERE = ("--bind", "127.0.0.1")      # the viewer with a window is a server, too: reached from this machine alone


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(main, "COMMANDS", ("view",))


@pytest.fixture
def opened(monkeypatch):
    """The arguments with which the viewer is started, in place of this process."""
    seen = []
    def execv(path, arguments):
        seen[:] = arguments
        raise SystemExit

    monkeypatch.setattr(os, "execv", execv)
    return seen


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def port() -> int:
    return free_port()


def listening_at(port: int) -> set[str]:
    """Addresses at which somebody listens on a port."""
    return {one.laddr.ip for one in psutil.net_connections("tcp") if one.status == "LISTEN" and one.laddr.port == port}


def record(path, frames=20, **options):
    writer = RecordingWriter(path, None, **options)
    for k in range(frames):
        writer.log_cloud(k, k, np.ones((10, 3)), np.ones(10))
    assert writer.flush()
    return writer


def fetch(port: int, path: Path, wanted) -> None:
    """Save what is served at a port, as a viewer would get it, until `wanted(path)`; if one cannot, another tries."""
    end = time.monotonic() + TIMEOUT_S
    while not (path.exists() and wanted(path)):
        assert time.monotonic() < end, "what is served did not come"
        command = [str(Path(sys.executable).with_name("rerun")), f"rerun+http://127.0.0.1:{port}/proxy", "--bind",
                   "127.0.0.1", "--port", str(free_port()), "--save", str(path)]
        viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
                                  env=os.environ | {"TMPDIR": str(path.parent)})     # where it leaves a folder
        try:
            give_up = time.monotonic() + VIEWER_S
            while time.monotonic() < give_up and not (path.exists() and wanted(path)):
                time.sleep(0.1)
        finally:
            os.killpg(viewer.pid, signal.SIGKILL)


def frames_in(path) -> int:
    """Clouds in a file that is being written, whichever recordings they are of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            reader = RrdReader(path)
            return sum(chunk.num_rows for recording in reader.recordings()
                       for chunk in reader.stream(store=recording).filter(content="/points"))
        except (RuntimeError, ValueError):
            return 0


@pytest.mark.parametrize("arguments, expected", [
    ([], "RECORDING is missing: expected one or more .rrd files, or --connect HOST:PORT"),
    (["absent.rrd"], "recording is absent.rrd: expected an .rrd file that exists"),
    (["--connect", "robot"], "--connect is robot: expected HOST:PORT, such as 127.0.0.1:9876"),
    (["--connect", "127.0.0.1:1"], "expected a recorder that serves there, with live_port:=1"),
])
def test_what_cannot_be_shown_is_one_line(refusal, opened, arguments, expected):
    assert expected in refusal("view", *arguments) and not opened


def test_a_file_that_is_no_recording_is_refused(refusal, opened, tmp_path):
    record(tmp_path / "a.rrd").close()
    (tmp_path / "named.rrd").write_text("# words")
    said = refusal("view", tmp_path / "a.rrd", tmp_path / "named.rrd")
    assert "named.rrd: expected an .rrd file, as the recorder writes it" in said and not opened


def test_where_there_is_a_screen_the_viewer_opens(srt3d, monkeypatch, tmp_path, opened, port):
    monkeypatch.setenv("DISPLAY", ":0")
    with record(tmp_path / "a.rrd", live_port=port):
        srt3d("view", tmp_path / "a.rrd")
        assert Path(opened[0]).name == "rerun" and opened[1:] == [*HERE, str(tmp_path / "a.rrd")]
        srt3d("view", "--connect", f"127.0.0.1:{port}")
        assert opened[1:] == [*HERE, f"rerun+http://127.0.0.1:{port}/proxy"]


@pytest.mark.parametrize("variables, address", [
    ({"LOGNAME": "robin", "SSH_CONNECTION": "10.0.0.2 50000 10.0.0.7 22"}, "robin@10.0.0.7"),     # from a laptop
    ({}, socket.gethostname()),         # without an account
])
def test_without_a_screen_the_line_for_ssh_is_printed(srt3d, monkeypatch, tmp_path, port, variables, address):
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(os, "getuid", lambda: 54321)        # as docker run --user has it
    with record(tmp_path / "a.rrd", live_port=port):
        code, out, _ = srt3d("view", "--connect", f"127.0.0.1:{port}")
    assert code == 0 and f"  ssh -L {port}:127.0.0.1:{port} {address}\n" in out


def test_without_a_screen_recordings_are_served_on_the_loopback_interface(tmp_path):
    for name in ("a.rrd", "b.rrd"):
        record(tmp_path / name).close()
    command = [sys.executable, "-c", "import sys; from srt3d_ros.cli import main; main.COMMANDS = ('view',); "
               "sys.exit(main.main(sys.argv[1:]))", "view", str(tmp_path / "a.rrd"), str(tmp_path / "b.rrd")]
    serving = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        lines = iter(serving.stdout.readline, "")
        served = next(int(match[1]) for line in lines if (match := re.search(r"ssh -L (\d+):127.0.0.1:\1 ", line)))
        fetch(served, tmp_path / "seen.rrd", lambda path: frames_in(path) == 40)
        assert listening_at(served) == {"127.0.0.1"}
        serving.send_signal(signal.SIGINT)
        assert serving.wait(60) == 0 and not listening_at(served)
    finally:
        serving.terminate()
        serving.wait(60)


def test_who_connects_late_gets_what_came_before_also_over_the_next_file(tmp_path, port):
    for number in range(2):         # the port is free again after the first
        with record(tmp_path / f"{number}.rrd", live_port=port) as writer:
            fetch(port, tmp_path / f"seen{number}.rrd", lambda path: frames_in(path) == 20)
            assert listening_at(port) == {"127.0.0.1"}
        assert writer.error is None and frames_in(tmp_path / f"{number}.rrd") == 20


def test_a_port_that_is_taken_gives_one_line(tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        with pytest.raises(InvalidInput, match=f"live_port is {taken}: expected a port that is free"):
            RecordingWriter(tmp_path / "a.rrd", None, live_port=taken)
