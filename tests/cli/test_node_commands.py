"""`srt3d node` and `play` start a node with the parameters that their options name, and no others."""

import sys
from types import SimpleNamespace

import pytest


@pytest.mark.parametrize("command, expected", [
    (["node", "player", "--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"],
     ["player", "--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"]),
    (["play", "a file: 1.npz", "--rate-hz", "5", "--motion", "walk"],
     ["player", "--ros-args", "-p", 'input:="a file: 1.npz"', "-p", "rate_hz:=5.0", "-p",
      'motion:="walk"']),
    (["play", "a.npz", "--sensor-file", "spad.json"],
     ["player", "--ros-args", "-p", 'input:="a.npz"', "-p", 'sensor_file:="spad.json"']),
    (["play", "b.npz", "--frames", "3", "--namespace", "/front/", "--ros-args", "-r", "photons:=/spad/raw"],
     ["player", "--ros-args", "-p", 'input:="b.npz"', "-p", "frames:=3", "-r", "__ns:=/front", "-r",
      "photons:=/spad/raw"]),
])
def test_options_become_parameters(monkeypatch, srt3d, command, expected):
    seen = []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.player", SimpleNamespace(main=lambda: seen.extend(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    assert srt3d(*command)[0] == 0
    assert seen == expected


def test_a_namespace_is_checked(refusal):
    assert refusal("play", "simulator", "--namespace", "a-b").startswith("--namespace is a-b: expected names")
