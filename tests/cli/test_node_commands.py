"""`srt3d node` and `play` start a node with the parameters that their options name, and no others."""

import json
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.nodes import all_specs
from srt3d_ros.processes.node_command import NODES


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


@pytest.mark.parametrize("name", NODES)
def test_the_help_of_a_node_lists_its_parameters_with_defaults_and_meaning(srt3d, name):
    code, said, _ = srt3d("node", name, "--help")
    assert code == 0 and f"ros2 run srt3d_ros {name} " in said
    for parameter in all_specs()[name].table:
        assert f"  {parameter.name}:={json.dumps(parameter.default)}  ({parameter.expected}" in said
        assert " ".join(parameter.description.split()) in " ".join(said.split())


def test_a_bag_is_played_with_its_own_options(monkeypatch, srt3d, refusal):
    seen = []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.bag_player", SimpleNamespace(
        main=lambda *given, **options: seen.extend((*given, options, *sys.argv[1:])) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    assert srt3d("play", "rec.mcap", "--rate", "2", "--loop", "--namespace", "front")[0] == 0
    assert seen == ["rec.mcap", {"rate": 2.0, "loop": True}, "--ros-args", "-r", "__ns:=/front"]
    for arguments, line in ((("rec.db3", "--rate-hz", "5"), "--rate-hz is for photon files and the simulator, and rec"),
                            (("a.npz", "--loop"), "--loop is for bags, and a.npz is no bag"),
                            (("rec.mcap", "--rate", "0"), "--rate is 0.0: expected a number above 0")):
        assert refusal("play", *arguments).startswith(line)


def test_a_namespace_is_checked(refusal):
    assert refusal("play", "simulator", "--namespace", "a-b").startswith("--namespace is a-b: expected names")
