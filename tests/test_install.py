"""The package installs with pip (from an sdist) and with colcon, and ROS 2's tools then find it."""

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

import srt3d_ros
from srt3d_ros.processes.node_command import NODES

NOT_SOURCE = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "install", "log", "dist", "demo-out")


def run(command, cwd, **variables) -> str:
    done = subprocess.run(command, cwd=cwd, env={**os.environ, **variables}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def source(repository, tmp_path_factory) -> Path:
    """A copy of the source tree, for builds to write into."""
    return Path(shutil.copytree(repository, tmp_path_factory.mktemp("copy") / "srt3d_ros", ignore=NOT_SOURCE,
                                symlinks=True))


@pytest.fixture(scope="module")
def by_pip(source, tmp_path_factory) -> Path:
    """The prefix of a plain pip install from an sdist."""
    prefix = tmp_path_factory.mktemp("pip")
    run([sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", prefix / "dist"], cwd=source)
    (sdist,) = (prefix / "dist").iterdir()
    run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index",
         "--ignore-installed", "--prefix", prefix, sdist], cwd=prefix)
    return prefix


@pytest.fixture(scope="module")
def by_colcon(source, tmp_path_factory) -> Path:
    """The prefix of a `colcon build`, which must print nothing on stderr."""
    if " " in sys.executable:
        pytest.skip("the scripts that setuptools writes for colcon do not start if the path of Python has a space")
    colcon = Path(sys.executable).parent / "colcon"
    if not colcon.exists():
        pytest.skip("colcon is not installed")
    workspace = tmp_path_factory.mktemp("colcon")
    said = run([colcon, "--log-base", workspace / "log", "build", "--base-paths", source, "--build-base",
                workspace / "build", "--install-base", workspace / "install"], workspace, PYTHONDONTWRITEBYTECODE="")
    assert "stderr" not in said, said
    return workspace / "install" / "srt3d_ros"


@pytest.fixture(params=["by_pip", "by_colcon"])
def prefix(request) -> Path:
    return request.getfixturevalue(request.param)


@pytest.fixture
def environment(prefix) -> dict[str, str]:
    """Variables with which Python and ROS 2 use the installed package instead of the source tree."""
    base = {"base": str(prefix), "platbase": str(prefix)}
    return {"AMENT_PREFIX_PATH": str(prefix), "PYTHONPATH": sysconfig.get_path("purelib", vars=base)}


def test_ros2_run_finds_the_nodes(prefix, monkeypatch):
    packages = pytest.importorskip("ament_index_python.packages")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    folder = Path(packages.get_package_prefix("srt3d_ros")) / "lib" / "srt3d_ros"
    assert sorted(path.name for path in folder.iterdir() if os.access(path, os.X_OK)) == sorted(NODES)


def test_the_command_is_on_path_and_a_node_found_so_runs_and_gets_its_ros_arguments(prefix, environment, tmp_path):
    assert run([prefix / "bin" / "srt3d", "--version"], tmp_path, **environment) == f"srt3d {srt3d_ros.__version__}\n"
    done = subprocess.run([prefix / "lib" / "srt3d_ros" / "sketcher", "--ros-args", "-p", "layout:=a b"], cwd=tmp_path,
                          env={**os.environ, **environment}, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "srt3d: error: layout is a b: expected float32 or int16\n")


def test_shared_files_and_package_data_are_installed(prefix, environment, repository):
    def names(place: Path) -> set[Path]:
        return {path.relative_to(place) for path in place.rglob("*")
                if path.is_file() and "__pycache__" not in path.parts}
    for folder in ("msg_schemas", "launch", "config", "examples"):
        assert names(prefix / "share" / "srt3d_ros" / folder) == names(repository / folder)
    assert names(Path(environment["PYTHONPATH"]) / "srt3d_ros") == names(repository / "srt3d_ros")


@pytest.fixture
def ros2(prefix, repository, tmp_path):
    """Run `ros2 …` with the installed package, but with the source tree's compiled kernels: (exit code, output)."""
    pytest.importorskip("ros2launch")

    def run_ros2(*arguments, until: str = "") -> tuple[int, str]:
        command = [Path(sys.executable).parent / "ros2", *arguments]
        variables = {"AMENT_PREFIX_PATH": str(prefix), "PYTHONPATH": str(repository), "ROS_LOG_DIR": str(tmp_path)}
        process = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, **variables}, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True, start_new_session=True)
        said = ""
        for line in process.stdout:
            said += line
            if until and all(text in said for text in until.split("|")):
                os.killpg(process.pid, signal.SIGINT)       # as Ctrl-C in a terminal does
                until = ""
        return process.wait(), said

    return run_ros2


def test_ros2_run_starts_a_node(ros2):
    code, said = ros2("run", "srt3d_ros", "sketcher", "--ros-args", "-r", "photons:=/spad/raw", "-r", "__ns:=/front",
                      "-p", "autostart:=false", until="[front.sketcher]: unconfigured")
    assert (code, "Traceback" in said) == (0, False), said


def test_the_launch_system_runs_the_pipeline(ros2, tmp_path):
    _, said = ros2("launch", "srt3d_ros", "srt3d.launch.py", "input:=simulator", "namespace:=/front",
                      "config:=scanner_141x141", "record:=run.rrd", "device:=cpu", until="|".join(
                          f"[front.{name}]: {word}" for name, word in
                          [("player", "ready"), ("sketcher", "ready"), ("reconstructor", "ready"),
                           ("recorder", "recording to")]))
    assert said.count("process has finished cleanly") == 4, said
    assert (tmp_path / "run.rrd").stat().st_size > 0


def test_a_player_that_ends_ends_what_was_launched(ros2):
    _, said = ros2("launch", "srt3d_ros", "srt3d.launch.py", "input:=no such file.npz")
    assert "exit code 2," in said, said
    others = said.count("process has finished cleanly") + said.count("exit code -2,")    # -2: asked while it started
    assert "no such file.npz" in said and others == 2, said


def test_a_parameter_or_a_file_that_does_not_exist_is_refused(ros2):
    _, said = ros2("launch", "srt3d_ros", "srt3d.launch.py", "config:=nothing")
    assert 'config "nothing": no such parameter file' in said and "process started" not in said, said
    _, said = ros2("launch", "srt3d_ros", "srt3d.launch.py", "sketcher.sketchsize:=5")
    assert "sketcher has no parameter sketchsize: did you mean sketch_size?" in said, said
    assert "process started" not in said, said


def test_versions_agree(repository):
    """Of package.xml, CITATION.cff and the newest entry of the changelog."""
    changelog = pytest.importorskip("catkin_pkg.changelog").get_changelog_from_path(repository / "CHANGELOG.rst")
    released = [version for version, date, _ in changelog.foreach_version() if date][-1]
    version = ElementTree.parse(repository / "package.xml").getroot().findtext("version")
    cited = yaml.safe_load((repository / "CITATION.cff").read_text())["version"]
    assert {released, version, cited} == {srt3d_ros.__version__}


EVERY_METHOD = """
import numpy as np, srt3d_ros
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.processes.versions import versions
sensor = SensorModel(2, 3, 100, 1e-10, [1, 2, 1])
frame = PhotonEvents(np.repeat(np.arange(6, dtype=np.uint32), 40), np.full(240, 50, np.uint16))
for name in METHODS:
    assert len(srt3d_ros.reconstruct(frame, sensor=sensor, method=name, device="cpu")) == 6
versions()
"""
NODES_AND_COMMANDS = f"""
import importlib
from srt3d_ros.cli.main import COMMANDS, parser
parser(COMMANDS)
for name in {NODES}:
    importlib.import_module(f"srt3d_ros.nodes.{{name}}")
"""
CORE = """
import importlib, pkgutil, srt3d_ros.core as core
for module in pkgutil.walk_packages(core.__path__, "srt3d_ros.core."):
    importlib.import_module(module.name)
"""
LIBRARY = "import sys, srt3d_ros\nassert 'numpy' not in sys.modules\nsrt3d_ros.reconstruct"
HEAVY = {"torch", "numba", "rclpy", "rerun", "scipy", "matplotlib", "PIL", "sensor_msgs", "std_msgs", "rosbags"}


@pytest.mark.parametrize("code, unused", [
    (EVERY_METHOD, {"torch"}), (NODES_AND_COMMANDS, {"torch"}), (CORE, HEAVY), (LIBRARY, HEAVY)],
    ids=["methods", "nodes", "core", "library"])
def test_packages_that_are_not_needed_are_not_imported(repository, code, unused):
    imported = run([sys.executable, "-c", f"{code}\nimport sys\nprint(*sys.modules)"], repository).split()
    assert "srt3d_ros" in imported and unused & set(imported) == set()
