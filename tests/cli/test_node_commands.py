"""`srt3d node` starts a node with the parameters that its options name, and describes it."""

import json
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.nodes import all_specs
from srt3d_ros.processes.node_command import NODES


def test_options_become_parameters(monkeypatch, srt3d):
    options, seen = ["player", "--ros-args", "-p", "input:=a b.npz", "-r", "photons:=/spad/raw"], []
    monkeypatch.setitem(sys.modules, "srt3d_ros.nodes.player", SimpleNamespace(main=lambda: seen.extend(sys.argv) or 0))
    monkeypatch.setattr(sys, "argv", ["srt3d"])
    assert srt3d("node", *options)[0] == 0
    assert seen == options


@pytest.mark.parametrize("name", NODES)
def test_the_help_of_a_node_lists_its_parameters_with_defaults_and_meaning(srt3d, name):
    code, said, _ = srt3d("node", name, "--help")
    assert code == 0 and f"ros2 run srt3d_ros {name} " in said
    for parameter in all_specs()[name].table:
        assert f"  {parameter.name}:={json.dumps(parameter.default)}  ({parameter.expected}" in said
        assert " ".join(parameter.description.split()) in " ".join(said.split())
