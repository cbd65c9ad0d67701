"""`srt3d node` and `play` start a node with the parameters that their options name, and no others."""

import json
import subprocess
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
    (["play", "b.npz", "--frames", "3", "--namespace", "/front/", "-r", "photons:=/spad/raw"],
     ["player", "--ros-args", "-p", 'input:="b.npz"', "-p", "frames:=3", "-r", "__ns:=/front", "-r",
      "photons:=/spad/raw"]),
    (["play", "rec.mcap", "--rate", "2", "--loop", "--start-offset", "3", "--clock", "-r", "/spad/raw:=/photons"],
     ["player", "--ros-args", "-p", 'input:="rec.mcap"', "-p", "rate:=2.0", "-p", "loop:=true", "-p",
      "start_offset:=3.0", "-p", "clock:=40.0", "-r", "/spad/raw:=/photons"]),
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


def test_an_option_that_is_for_another_source_is_refused_in_one_line():
    play = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "play", "a.npz", "--rate", "2"], text=True,
                          capture_output=True)
    assert play.returncode == 2 and "rate 2.0: only for a bag, and input a.npz is a photon file" in play.stderr


def test_a_namespace_is_checked(refusal):
    assert refusal("play", "simulator", "--namespace", "a-b").startswith("--namespace is a-b: expected names")
