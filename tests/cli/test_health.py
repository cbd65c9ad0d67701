"""`srt3d health`: a table of what nodes report, or a line that nobody is heard."""

import json
import sys

from std_msgs.msg import String

from srt3d_ros.processes.private_network import claim_domain
from tests.nodes.conftest import graph  # noqa: F401
from tools.processes import Process

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
