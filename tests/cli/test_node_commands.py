"""`srt3d node`, `play` and `bag-record` start a node with the parameters that their options name, and no others."""

import subprocess
import sys
from types import SimpleNamespace

import pytest


@pytest.mark.parametrize("command, expected", [
    (["node", "player", "--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"],
     ["player", "--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"]),
    (["play", "a file: 1.npz", "--rate-hz", "5", "--gates", "--motion", "drone"],
     ["player", "--ros-args", "-p", 'input:="a file: 1.npz"', "-p", "rate_hz:=5.0", "-p", 'output:="gates"', "-p",
      'motion:="drone"']),
    (["play", "a.npz", "--no-loop", "--lossless"],
     ["player", "--ros-args", "-p", 'input:="a.npz"', "-p", "loop:=false", "-p", "lossless:=true", "-p",
      "bag_loop:=false"]),
    (["play", "bag", "--rate", "2", "--start-s", "1", "--stamps", "now", "--photons-topic", "/spad/raw",
      "--odom-topic", "/filtered"],
     ["player", "--ros-args", "-p", 'input:="bag"', "-p", "bag_rate:=2.0", "-p", "bag_start_s:=1.0", "-p",
      'bag_stamps:="now"', "-p", 'bag_photons_topic:="/spad/raw"', "-p", 'bag_odom_topic:="/filtered"']),
    (["play", "bag.mcap", "--loop", "--clock", "--frames", "3"],
     ["player", "--ros-args", "-p", 'input:="bag.mcap"', "-p", "frames:=3", "-p", "loop:=true", "-p", "clock:=true",
      "-p", "bag_loop:=true"]),
    (["play", "a.npz", "--duration-s", "2", "--namespace", "/front/", "--ros-args", "-r", "photons:=/spad/raw"],
     ["player", "--ros-args", "-p", 'input:="a.npz"', "-p", "duration_s:=2.0", "-r", "__ns:=/front", "-r",
      "photons:=/spad/raw"]),
    (["bag-record", "a bag"], ["bag_recorder", "--ros-args", "-p", 'path:="a bag"']),
    (["bag-record", "out", "--topics", "sketch", "sketch/sensor", "--format", "sqlite3", "--max-duration", "2",
      "--max-size", "100", "--namespace", "left"],
     ["bag_recorder", "--ros-args", "-p", 'path:="out"', "-p", 'topics:="sketch,sketch/sensor"', "-p",
      'format:="sqlite3"', "-p", "max_duration_s:=2.0", "-p", "max_size_mb:=100", "-r", "__ns:=/left"]),
])
def test_options_become_parameters(monkeypatch, srt3d, command, expected):
    seen = []
    for name in ("player", "bag_recorder"):
        monkeypatch.setitem(sys.modules, f"srt3d_ros.nodes.{name}",
                            SimpleNamespace(main=lambda: seen.extend(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    assert srt3d(*command)[0] == 0
    assert seen == expected


def test_a_namespace_is_checked(refusal):
    assert refusal("play", "simulator", "--namespace", "a-b").startswith("--namespace is a-b: expected letters")


@pytest.mark.parametrize("command, code, said", [
    (["play", "simulator", "--frames", "2", "--rate-hz", "50", "--ros-args", "-p", "wait_for_subscribers:=0"], 0,
     "ready"),
    (["play", "simulator", "--rate-hz", "-1"], 2, "rate_hz is -1.0: expected a number from 0 to 10000 Hz\n"),
    (["bag-record", ".", "--topics", "photons"], 2, ": expected a folder that is not there\n"),
])
def test_the_nodes_take_them(repository, command, code, said):
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", *command], cwd=repository, capture_output=True,
                          text=True)
    assert done.returncode == code and said in done.stderr, done.stderr
    assert code == 0 or done.stderr.count("\n") == 1 and done.stderr.startswith("srt3d: error: ")
