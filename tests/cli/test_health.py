"""`srt3d health`: a table of what nodes report, or a line that nobody is heard."""

import json
import sys

from std_msgs.msg import String

from srt3d_ros.processes.private_network import claim_domain
from tests.nodes.conftest import graph  # noqa: F401
from tools.processes import Process

HEALTH = [sys.executable, "-m", "srt3d_ros.cli.main", "health"]


def test_every_node_has_a_line_and_where_there_is_none_it_fails(graph, monkeypatch):  # noqa: F811
    names = [f"{graph.namespace[1:]}/{graph.start(name).ready() and name}" for name in ("sketcher", "reconstructor")]
    health = Process(HEALTH)
    assert health.code() == 0, health.text
    assert f"waiting for a sensor description on {graph.namespace}/sensor (publishers: 0) for " in health.text
    assert [line.split()[:2] for line in health.lines] == [["node", "level"], *([name, "WARN"] for name in names)]
    monkeypatch.setenv("ROS_DOMAIN_ID", str(claim_domain()))
    health = Process([*HEALTH, "--watch"])
    assert health.code() == 1 and len(health.lines) == 1 and "no node has reported on /diag" in health.text


def test_an_error_and_a_node_that_has_stopped_to_report_fail_it(graph):  # noqa: F811
    reconstructor, sketcher = graph.start("reconstructor").ready(), graph.start("sketcher").ready()
    names = [f"{graph.namespace[1:]}/{name}" for name in ("sketcher", "reconstructor")]
    graph.wait(lambda: graph.report("sketcher").get("read_by") == names[1], "the reader in the sketcher's report")
    graph.latched("sensor").publish(String(data="{"))
    sketcher.says("broken JSON")
    health = Process([*HEALTH, "--json"])
    assert health.code() == 1
    first, second = sorted(json.loads(health.lines[-1]), key=lambda one: one["name"], reverse=True)
    assert [(one["name"], one["level"]) for one in (first, second)] == list(zip(names, ("ERROR", "WARN")))
    assert "broken JSON" in first["why"] and first["state"] == "active" and first["counts"]["errors"] == 1
    reconstructor.pause()
    health = Process(HEALTH)
    assert health.code() == 1
    assert health.lines[-1].split()[:2] == [names[1], "STALE"] and "no report for " in health.lines[-1]
    reconstructor.resume()
