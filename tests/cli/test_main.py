"""What `srt3d` does about mistakes, interruptions and missing packages, whatever the sub-command."""

import os
import subprocess
import sys

import pytest

from srt3d_ros import __version__
from srt3d_ros.cli import main, node
from srt3d_ros.errors import InvalidInput


def failing_with(error: BaseException):
    def run(*_):
        raise error
    return run


@pytest.mark.parametrize("error, code, line", [
    (InvalidInput("toa", -1, "bins in [0, 10)"), 2, "srt3d: error: toa is -1: expected bins in [0, 10)\n"),
    (PermissionError(13, "Permission denied", "a.npz"), 2, "srt3d: error: a.npz: Permission denied\n"),
    (KeyboardInterrupt(), 130, ""),
    (ModuleNotFoundError(name="rerun"), 1,
     "srt3d: error: rerun is not installed: pip install '.[record]' in the clone\n"),
    (ModuleNotFoundError(name="rclpy"), 1,
     "srt3d: error: rclpy is not installed: source a ROS 2 installation, or pip install '.[ros]' in the clone\n"),
])
def test_what_goes_wrong_is_one_line_and_an_exit_code(monkeypatch, srt3d, error, code, line):
    monkeypatch.setattr(node, "start", failing_with(error))
    assert srt3d("node", "sketcher") == (code, "", line)


def test_review_asks_once_for_all_that_it_needs_and_our_defects_are_not_disguised(monkeypatch, srt3d):
    monkeypatch.setattr("srt3d_ros.cli.review.run", failing_with(ModuleNotFoundError(name="pyarrow")))
    expected = "srt3d: error: pyarrow is not installed: pip install '.[review]' in the clone\n"
    assert srt3d("review", "a.rrd") == (1, "", expected)
    monkeypatch.setattr(node, "start", failing_with(ValueError("a defect")))
    with pytest.raises(ValueError):
        main.main(["node", "sketcher"])


@pytest.mark.parametrize("argv, code, expected", [
    ([], 2, "Try srt3d "), (["node", "--help"], 0, "sketcher --ros-args")])
def test_who_asks_for_nothing_or_for_help_sees_the_help(srt3d, argv, code, expected):
    found, text, _ = srt3d(*argv)
    assert found == code and expected in text


@pytest.mark.parametrize("argv, expected", [
    (["no-such-command"], "no-such-command"), (["node", "no-such-node"], "no-such-node"),
    (["--no-such-option"], "required: COMMAND"),
    (["info", "a.npz", "--no-such-option"], "unrecognized arguments: --no-such-option (see srt3d info --help)")])
def test_a_wrong_command_line_is_one_line_and_exit_code_2(refusal, argv, expected):
    assert expected in refusal(*argv)


def test_version(srt3d):
    assert srt3d("--version") == (0, f"srt3d {__version__}\n", "")


def python(repository, script: str, **options) -> subprocess.CompletedProcess:
    """Run a script that may use `main` and `node`."""
    imports = "import sys, srt3d_ros.cli.main as main, srt3d_ros.cli.node as node\n"
    return subprocess.run([sys.executable, "-c", imports + script], cwd=repository, stderr=subprocess.PIPE, text=True,
                          **options)


@pytest.mark.parametrize("command", ["up", "demo --motion walk", "node sketcher"])
def test_without_ros_its_extra_is_named_and_nothing_is_left_behind(repository, tmp_path, command):
    done = python(repository, f"""
class Absent:
    def find_spec(self, name, *_):
        if name in ("rclpy", "std_msgs", "sensor_msgs", "nav_msgs"):
            raise ModuleNotFoundError(name=name)

sys.meta_path.insert(0, Absent())
sys.path.insert(0, {str(repository)!r})
import os; os.chdir({str(tmp_path)!r})
sys.exit(main.main({command.split()}))""")
    assert done.returncode == 1 and list(tmp_path.iterdir()) == []
    assert done.stderr.endswith("is not installed: source a ROS 2 installation, or pip install '.[ros]' in the clone\n")
    assert len(done.stderr.splitlines()) == 1


def helped(repository, *argv: str, without: tuple[str, ...]) -> subprocess.CompletedProcess:
    """Ask for help; exit code 1 if that imports one of these."""
    return python(repository, f"try: main.main([*{argv}, '--help'])\n"
                  "except SystemExit: pass\n"
                  f"sys.exit(any(name in sys.modules for name in {without}))", stdout=subprocess.PIPE)


def test_help_names_every_command_and_loads_nothing_heavy(repository):
    info = helped(repository, "info", without=("numba", "scipy", "matplotlib", "srt3d_ros.datasets.sources"))
    assert (info.returncode, info.stderr) == (0, "")
    done = helped(repository, without=("torch", "numba", "rclpy", "rerun", "matplotlib", "numpy"))
    assert (done.returncode, done.stderr) == (0, "")
    assert set(main.COMMANDS) <= {line.split()[0] for line in done.stdout.splitlines() if line.startswith("    ")}


@pytest.mark.parametrize("command", [(), *((name,) for name in main.COMMANDS)])
def test_help_fits_a_terminal_of_80_columns(srt3d, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = srt3d(*command, "--help")
    assert code == 0 and max(map(len, out.splitlines())) <= 80


def test_a_reader_that_stops_reading_is_no_error_and_a_node_needs_nothing_of_other_commands(repository):
    read, write = os.pipe()
    os.close(read)
    done = python(repository, "def start(name, ros_args):\n"
                  "    assert not {'numpy', 'tqdm'} & set(sys.modules)\n"
                  "    print('a line')\n"
                  "node.start = start\n"
                  "sys.exit(main.main(['node', 'sketcher']))", stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")
