"""`srt3d bag-record` starts the bag_recorder with the parameters that its options name, and no others."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.cli import main


@pytest.fixture
def recorder_arguments(monkeypatch):
    seen = []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.bag_recorder",
                        SimpleNamespace(main=lambda: seen.extend(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    return seen


@pytest.mark.parametrize("options, expected", [
    (["a bag"], ["-p", 'path:="a bag"']),
    (["out", "--topics", "sketch", "sketch/sensor", "--format", "sqlite3"],
     ["-p", 'path:="out"', "-p", 'topics:="sketch,sketch/sensor"', "-p", 'format:="sqlite3"']),
    (["out", "--max-duration", "2", "--max-size", "100", "--namespace", "/left/", "--ros-args", "-r", "photons:=raw"],
     ["-p", 'path:="out"', "-p", "max_duration_s:=2.0", "-p", "max_size_mb:=100", "-r", "__ns:=/left", "-r",
      "photons:=raw"]),
])
def test_options_become_parameters(recorder_arguments, options, expected):
    assert main.main(["bag-record", *options]) == 0
    assert recorder_arguments == ["bag_recorder", "--ros-args", *expected]


def test_the_recorder_takes_them(repository, tmp_path):
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "bag-record", tmp_path, "--topics", "photons"],
                          cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, f"bag is {tmp_path}: expected a folder that is not there\n")
