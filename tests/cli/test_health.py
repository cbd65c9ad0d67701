"""`srt3d health`: a table of what nodes report, or a line that nobody is heard."""

import sys

from srt3d_ros.processes.private_network import claim_domain
from tests.nodes.conftest import graph  # noqa: F401
from tools.processes import Process

HEALTH = [sys.executable, "-m", "srt3d_ros.cli.main", "health"]


def test_every_node_has_a_line_and_where_there_is_none_it_fails(graph, monkeypatch):  # noqa: F811
    names = [f"{graph.namespace[1:]}/{graph.start(name).ready() and name}" for name in ("sketcher", "reconstructor")]
    health = Process(HEALTH)
    assert health.code() == 0 and "waiting for a sensor description on sensor" in health.text
    assert [line.split()[:2] for line in health.lines] == [["node", "level"], *([name, "WARN"] for name in names)]
    monkeypatch.setenv("ROS_DOMAIN_ID", str(claim_domain()))
    health = Process([*HEALTH, "--watch"])
    assert health.code() == 1 and len(health.lines) == 1 and "no node has reported on /diag" in health.text
