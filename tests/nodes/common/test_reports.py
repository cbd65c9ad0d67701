"""What readers make of the statuses of nodes: which are STALE, and what became of a player's frames."""

from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from srt3d_ros.nodes.common import reports as module
from srt3d_ros.nodes.common.reports import Chain, Reports, in_a_line
from srt3d_ros.nodes.common.status import NodeStatus

IDLE = NodeStatus("sketcher", "OK", "fine", state="active", ready=True,
                  counts={"messages_in": 5, "frames_out": 5, "dropped": 0, "message_lost": 0})


def report(reports: Reports, name: str, counts: dict | None = None, **values: object) -> None:
    status = replace(IDLE, name=name, counts=IDLE.counts | (counts or {}), **values)
    reports.add(DiagnosticArray(status=[status.to_message()]))


@pytest.fixture
def clock(monkeypatch):
    """The clock of the reports, [s], which stands still."""
    now_s = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    return now_s


def test_a_node_that_stops_to_report_is_stale_and_one_that_ends_is_gone(clock):
    reports = Reports()
    report(reports, "a/sketcher", read_by=("a/reconstructor", "rviz"), sent_by=("a/player", "spad_driver"))
    report(reports, "a/recorder", state="finalized")
    assert [one.level for one in reports.current()] == ["OK", "OK"] and not reports.complete
    clock[0] += 7.5
    sketcher, reconstructor, player = reports.current()
    assert sketcher == replace(IDLE, name="a/sketcher", level="STALE", why="no report for 8 s", since_s=7.5,
                               ready=False, read_by=("a/reconstructor", "rviz"),
                               sent_by=("a/player", "spad_driver"))
    assert (reconstructor.name, reconstructor.level, reports.complete) == ("a/reconstructor", "STALE", True)
    assert in_a_line([sketcher, player]) == ("no clouds; dropped so far: 0; a/sketcher STALE: no report for 8 s; "
                                             "a/player STALE: no report for 8 s")
    report(reports, "a/sketcher", facts={"reconstruct_ms": 9.5, "latency_p50_ms": 35.4})
    assert reports.current()[0].level == "OK" and in_a_line(reports.values()).startswith("no clouds; ")


def test_a_chain_is_ready_when_every_node_is_and_is_read_by_the_next(clock):
    chain = Chain(["a/sketcher", "a/recorder"], reports := Reports())
    assert chain.missing([]).count("(no report on /diagnostics)") == 2
    report(reports, "a/sketcher", ready=False, waiting_for="a sensor")
    report(reports, "a/recorder")
    assert chain.missing(["a/sketcher"]) == "a/sketcher (a sensor), a/recorder (not connected to the node before it)"
    report(reports, "a/sketcher", level="ERROR", why="gate is 500-600", ready=False, waiting_for="a sensor")
    assert chain.missing(["a/sketcher"]).startswith("a/sketcher (gate is 500-600), ")
    report(reports, "a/sketcher", read_by=("rviz", "a/recorder"))
    assert chain.missing(["a/sketcher"]) == ""
    clock[0] += 6
    assert chain.missing(["a/sketcher"]).startswith("a/sketcher (no report for 6 s)")


def test_frames_are_accounted_for_from_node_to_node():
    chain = Chain(["sketcher", "reconstructor", "recorder"], reports := Reports())
    for name in ("sketcher", "reconstructor"):
        report(reports, name)
    report(reports, "recorder", {"clouds": 5})
    chain.begin()
    assert chain.outcome(10)[0] == 10
    report(reports, "sketcher", {"messages_in": 14, "message_lost": 1, "packets": 9, "frames_out": 14})
    report(reports, "reconstructor", {"messages_in": 14, "dropped": 2, "dropped.queue": 2, "frames_out": 11},
           facts={"reconstruct_ms": 9.5, "rate_out_hz": 8.61, "points_per_s": 171093.4, "latency_p50_ms": 35.4})
    report(reports, "recorder", {"clouds": 10, "messages_in": 60, "message_lost": 4, "dropped": 9})
    under_way, lost, came = chain.outcome(10)
    assert came == {"sketcher": 9, "reconstructor": 9, "recorder": 5} and under_way == 3
    assert lost == {"on the way to sketcher": 1, "queue in reconstructor": 2, "unfinished in reconstructor": 1,
                    "on the way to recorder": 1}
    assert in_a_line(reports.values()) == "8.6 clouds/s, 171,093 points/s, 35 ms old; dropped so far: 16"
