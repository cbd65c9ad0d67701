"""`srt3d play` starts the player with the parameters that its options name, and no others."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.cli import main


@pytest.fixture
def player_arguments(monkeypatch):
    seen = []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.player", SimpleNamespace(main=lambda: seen.extend(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    return seen


@pytest.mark.parametrize("options, expected", [
    (["simulator"], ["-p", 'input:="simulator"']),
    (["a file: 1.npz", "--rate-hz", "5", "--gates"],
     ["-p", 'input:="a file: 1.npz"', "-p", "rate_hz:=5.0", "-p", 'output:="gates"']),
    (["a.npz", "--no-loop", "--lossless"],
     ["-p", 'input:="a.npz"', "-p", "loop:=false", "-p", "lossless:=true", "-p", "bag_loop:=false"]),
    (["bag", "--rate", "2", "--start-s", "1", "--stamps", "now", "--photons-topic", "/spad/raw"],
     ["-p", 'input:="bag"', "-p", "bag_rate:=2.0", "-p", "bag_start_s:=1.0", "-p", 'bag_stamps:="now"',
      "-p", 'bag_photons_topic:="/spad/raw"']),
    (["bag.mcap", "--loop", "--clock"],
     ["-p", 'input:="bag.mcap"', "-p", "loop:=true", "-p", "bag_loop:=true", "-p", "clock:=true"]),
    (["simulator", "--namespace", "front"], ["-p", 'input:="simulator"', "-r", "__ns:=/front"]),
    (["a.npz", "--duration-s", "2", "--ros-args", "-r", "photons:=/spad/raw", "-p", "seed:=2"],
     ["-p", 'input:="a.npz"', "-p", "duration_s:=2.0", "-r", "photons:=/spad/raw", "-p", "seed:=2"]),
])
def test_options_become_parameters(player_arguments, options, expected):
    assert main.main(["play", *options]) == 0
    assert player_arguments == ["player", "--ros-args", *expected]


@pytest.mark.parametrize("options, code, said", [
    (["simulator", "--frames", "2", "--rate-hz", "50", "--ros-args", "-p", "wait_for_subscribers:=0"], 0, "ready"),
    (["no such file.npz"], 2, "no such file.npz"),
    (["simulator", "--namespace", "a-b"], 2, "--namespace is a-b: expected letters"),
    (["simulator", "--rate-hz", "-1"], 2, "rate_hz is -1.0: expected a number from 0 to 10000 Hz\n"),
])
def test_the_player_takes_them(repository, options, code, said):
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "play", *options], cwd=repository,
                          capture_output=True, text=True)
    assert done.returncode == code and said in done.stderr, done.stderr
    assert code == 0 or done.stderr.count("\n") == 1
