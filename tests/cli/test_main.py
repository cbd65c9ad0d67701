"""What `srt3d` does about mistakes, interruptions and missing packages, whatever the sub-command."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros import __version__
from srt3d_ros.cli import main, node
from srt3d_ros.errors import InvalidInput


@pytest.fixture
def failing_with(monkeypatch):
    """Make `srt3d node` raise this."""
    def arrange(error: BaseException):
        def start(name, ros_args):
            raise error
        monkeypatch.setattr(node, "start", start)
    return arrange


@pytest.mark.parametrize("error, code, line", [
    (InvalidInput("toa", -1, "bins in [0, 10)"), 2, "srt3d: error: toa is -1: expected bins in [0, 10)\n"),
    (FileNotFoundError(2, "No such file or directory", "a.npz"), 2, "srt3d: error: a.npz: No such file or directory\n"),
    (PermissionError(13, "Permission denied", "a.npz"), 2, "srt3d: error: a.npz: Permission denied\n"),
    (KeyboardInterrupt(), 130, ""),
    (ModuleNotFoundError("No module named 'rerun'", name="rerun"), 1,
     "srt3d: error: rerun is not installed: pip install 'srt3d_ros[record]'\n"),
    (ModuleNotFoundError("No module named 'rclpy'", name="rclpy"), 1,
     "srt3d: error: rclpy is not installed: source a ROS 2 installation, or pip install 'srt3d_ros[ros]'\n"),
])
def test_what_goes_wrong_is_one_line_and_an_exit_code(failing_with, capsys, error, code, line):
    failing_with(error)
    assert main.main(["node", "sketcher"]) == code
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize("missing", ["rerun", "matplotlib", "PIL", "jinja2"])
def test_review_asks_once_for_all_that_it_needs(monkeypatch, capsys, missing):
    def run(args):
        raise ModuleNotFoundError(name=missing)
    monkeypatch.setattr("srt3d_ros.cli.review.run", run)
    assert main.main(["review", "a.rrd"]) == 1
    assert capsys.readouterr().err == f"srt3d: error: {missing} is not installed: pip install 'srt3d_ros[review]'\n"


@pytest.mark.parametrize("error", [ValueError("a defect"), OSError("of no file"), ModuleNotFoundError("x", name="x")])
def test_a_defect_of_ours_is_not_disguised_as_bad_input(failing_with, error):
    failing_with(error)
    with pytest.raises(type(error)):
        main.main(["node", "sketcher"])


@pytest.mark.parametrize("argv", [[], ["no-such-command"], ["node"], ["node", "no-such-node"], ["--no-such-option"]])
def test_a_wrong_command_line_is_one_line_and_exit_code_2(capsys, argv):
    with pytest.raises(SystemExit) as stopped:
        main.main(argv)
    printed = capsys.readouterr()
    assert (stopped.value.code, printed.out) == (2, "")
    assert printed.err.startswith("srt3d: error: ") and printed.err.count("\n") == 1


def test_version(capsys):
    with pytest.raises(SystemExit) as stopped:
        main.main(["--version"])
    assert (stopped.value.code, capsys.readouterr().out) == (0, f"srt3d {__version__}\n")


def test_help_names_every_command_and_loads_nothing_heavy(repository):
    script = ("import sys, srt3d_ros.cli.main as main\n"
              "try: main.main(['--help'])\n"
              "except SystemExit: pass\n"
              "sys.exit(any(name in sys.modules for name in ('torch', 'numba', 'rclpy', 'rerun', 'matplotlib')))")
    done = subprocess.run([sys.executable, "-c", script], cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert set(main.COMMANDS) <= {line.split()[0] for line in done.stdout.splitlines() if line.startswith("    ")}


def test_a_reader_that_stops_reading_is_no_error(repository):
    read, write = os.pipe()
    os.close(read)
    script = ("import sys, srt3d_ros.cli.main as main, srt3d_ros.cli.node as node\n"
              "def start(name, ros_args): print('a line'); return 0\n"
              "node.start = start\n"
              "sys.exit(main.main(['node', 'sketcher']))")
    done = subprocess.run([sys.executable, "-c", script], cwd=repository, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


def test_a_node_starts_without_what_other_commands_need(repository):
    script = ("import sys, srt3d_ros.cli.main as main, srt3d_ros.cli.node as node\n"
              "node.start = lambda name, ros_args: 'numpy' in sys.modules or 'tqdm' in sys.modules\n"
              "sys.exit(main.main(['node', 'sketcher']))")
    assert subprocess.run([sys.executable, "-c", script], cwd=repository).returncode == 0


def test_a_node_gets_its_ros_arguments_unchanged(monkeypatch):
    seen = []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.player", SimpleNamespace(main=lambda: seen.append(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    arguments = ["--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"]
    assert main.main(["node", "player", *arguments]) == 0
    assert seen == [["player", *arguments]]
