"""`srt3d up`, `node` and `health`: options become arguments of nodes, or one line; a table of what nodes report."""

import json
import sys
from types import SimpleNamespace

import pytest
import yaml
from std_msgs.msg import String

from srt3d_ros.cli import main, up
from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes import all_specs
from srt3d_ros.processes.node_command import NODES
from srt3d_ros.processes.private_network import claim_domain
from tests.nodes.conftest import graph  # noqa: F401
from tools.processes import Process


def parsed(*options: str):
    return main.parser(("up",)).parse_args(["up", *options])


def test_what_is_nearer_to_the_command_line_wins(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**/sketcher:\n  ros__parameters:\n    sketch_size: 7\n")
    args = parsed("--config", "scanner_141x141", "--config", str(mine), "--device", "cpu", "--input", "1.0",
                  "-p", "reconstructor.device:=auto", "-p", "sketcher.extrinsics:=[0, 0.5]",
                  "-p", "sketcher.sketch_size:=5", "-p", "sketcher.qos_overrides./sketch.publisher.depth:=9")
    assert yaml.safe_load(up.parameters_yaml(args)) == {
        "/**/reconstructor": {"ros__parameters": {"device": "auto"}},
        "/**/sketcher": {"ros__parameters": {"extrinsics": "0,0.5", "sketch_size": 5,
                                                  "qos_overrides./sketch.publisher.depth": 9}},
        "/**/player": {"ros__parameters": {"input": "1.0", "wait_for": "sketcher reconstructor"}}}
    files = [value for flag, value in zip(*[iter(up.ros_arguments(args, str(mine))[1:])] * 2)
             if flag == "--params-file"]
    assert [path.rsplit("/", 1)[1] for path in files] == ["scanner_141x141.yaml", "mine.yaml", "mine.yaml"]


@pytest.mark.parametrize("options, line", [
    (["-p", "sketch_size:=5"], "sketch_size:=5: expected NODE.PARAMETER:=VALUE, NODE one of reconstructor"),
    (["-p", "sketcher.sketchsize:=5"], "sketcher has no parameter sketchsize: did you mean sketch_size?"),
    (["-p", "sketcher.sketch_size:=[1"], "sketcher.sketch_size:=[1: expected NODE.PARAMETER:=VALUE, NODE one of"),
    (["-p", "sketcher.sketch_size:="], "sketcher.sketch_size:=: expected NODE.PARAMETER:=VALUE, NODE one of"),
    (["-p", "driver.path:=a"], "driver.path:=a: expected NODE.PARAMETER:=VALUE, NODE one of"),
    (["-p", "player.ppp:=5"], "player.ppp:=5: expected NODE.PARAMETER:=VALUE, NODE one of reconstructor, sketcher,"),
    (["-r", "photon:=/x"], "-r is photon:=/x: expected TOPIC:=NAME, TOPIC one of background, camera_info"),
    (["-r", "photons=/x"], "-r is photons=/x: expected TOPIC:=NAME"),
    (["--record", "runs"], "--record is runs: expected a path that ends with .rrd"),
    (["--config", "nothing"], 'config "nothing": no such parameter file, neither'),
    (["--config", 300 * "a"], f'config "{300 * "a"}": no such'),
])
def test_a_mistake_is_one_line(options, line):
    with pytest.raises(InvalidInput) as refused:
        args = parsed(*options)
        up.parameters_yaml(args)
        up.ros_arguments(args, "own.yaml")
    assert str(refused.value).startswith(line) and "\n" not in str(refused.value)


@pytest.mark.parametrize("rule", ["points:=/robot/cloud", "/spad/raw:=photons", "sketcher:photons:=raw",
                                  "sketch/sensor:=description", "~/change_state:=change"])
def test_what_ros_2_can_remap_can_be(rule):
    assert rule in up.ros_arguments(parsed("-r", rule), "own.yaml")


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


HEALTH = [sys.executable, "-m", "srt3d_ros.cli.main", "health"]


def test_every_node_has_a_line_and_one_that_has_failed_or_stopped_to_report_fails_it(graph):  # noqa: F811
    reconstructor, sketcher = graph.start("reconstructor").ready(), graph.start("sketcher").ready()
    names = [f"{graph.namespace[1:]}/{name}" for name in ("sketcher", "reconstructor")]
    graph.wait(lambda: graph.report("sketcher").get("read_by") == names[1], "the reader in the sketcher's report")
    health = Process(HEALTH)
    assert health.code() == 0, health.text
    assert f"waiting for a sensor description on {graph.namespace}/sensor (publishers: 0) for " in health.text
    assert [line.split()[:2] for line in health.lines] == [["node", "level"], *([name, "WARN"] for name in names)]
    graph.latched("sensor").publish(String(data="{"))
    sketcher.says("broken JSON")
    reconstructor.pause()
    health = Process([*HEALTH, "--json"])
    assert health.code() == 1
    first, second = sorted(json.loads(health.lines[-1]), key=lambda one: one["name"], reverse=True)
    assert [(one["name"], one["level"]) for one in (first, second)] == list(zip(names, ("ERROR", "STALE")))
    assert "broken JSON" in first["why"] and first["state"] == "active" and first["counts"]["errors"] == 1
    assert "no report for " in second["why"]
    reconstructor.resume()


def test_where_no_node_is_heard_it_fails_in_a_line(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(claim_domain()))
    health = Process([*HEALTH, "--watch"])
    assert health.code() == 1 and len(health.lines) == 1 and "no node has reported on /diag" in health.text
