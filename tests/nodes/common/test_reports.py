"""What nodes report, and what readers make of it: statuses, missed messages, peers, and what became of frames."""

from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from srt3d_ros.nodes.common import peers
from srt3d_ros.nodes.common import reports as module
from srt3d_ros.nodes.common.endpoints import SequenceLoss
from srt3d_ros.nodes.common.reports import Chain, Reports
from srt3d_ros.nodes.common.status import LEVELS, NodeStatus

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
    sketcher, reconstructor, _ = reports.current()
    assert sketcher == replace(IDLE, name="a/sketcher", level="STALE", why="no report for 8 s", since_s=7.5,
                               ready=False, read_by=("a/reconstructor", "rviz"),
                               sent_by=("a/player", "spad_driver"))
    assert (reconstructor.name, reconstructor.level, reports.complete) == ("a/reconstructor", "STALE", True)
    report(reports, "a/sketcher", facts={"reconstruct_ms": 9.5, "latency_p50_ms": 35.4})
    assert reports.current()[0].level == "OK"


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
    assert chain.outcome(10) == (0, 10, 10)
    report(reports, "sketcher", {"messages_in": 14, "message_lost": 1, "packets": 9, "frames_out": 14})
    report(reports, "reconstructor", {"messages_in": 14, "dropped": 2, "dropped.queue": 2, "frames_out": 11},
           facts={"reconstruct_ms": 9.5, "rate_out_hz": 8.61, "points_per_s": 171093.4, "latency_p50_ms": 35.4})
    report(reports, "recorder", {"clouds": 10, "messages_in": 60, "message_lost": 4, "dropped": 9})
    assert chain.outcome(10) == (5, 5, 3)       # one before, in and behind the reconstructor


STATUS = NodeStatus("front/sketcher", "ERROR", "gate is 500-600: expected 0 to 399", 12.5, "active", False, "a frame",
                    ("front/reconstructor", "rviz"), (), {"messages_in": 5, "dropped.queue": 1},
                    {"rate_in_hz": 9.5, "device": "cpu: no GPU"}, "front/spad")


def test_a_status_is_the_same_behind_its_message():
    assert NodeStatus.from_message(STATUS.to_message()) == STATUS
    assert {name: NodeStatus("a", name).failed for name in LEVELS} == {
        "OK": False, "WARN": False, "ERROR": True, "STALE": True}


@pytest.mark.parametrize("level, values", [
    (b"\0", {"state": "active", "ready": "True"}), (b"\0", {"since_s": "long", "ready": "True"}),
    (b"\7", {"since_s": "1.0", "ready": "True"})])
def test_what_others_report_is_no_status(level, values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    assert NodeStatus.from_message(DiagnosticStatus(name="lidar", level=level, values=pairs)) is None


@pytest.mark.parametrize("numbers, missed", [
    ([1, 2, 3], [0, 0, 0]),
    ([7, 8], [0, 0]),                       # what came before we listened was not for us
    ([1, 3, 7], [0, 1, 3]),
    ([5, 6, 1, 3], [0, 0, 0, 1]),           # the publisher started again
    ([None, None], [0, 0]),
])
def test_gaps_between_the_numbers_of_one_publisher_are_misses(numbers, missed):
    for publishers, counted in ((1, missed), (2, [0] * len(missed))):       # numbers of two look alike
        gaps = SequenceLoss(lambda: publishers)
        assert [gaps.missed_before(number) for number in numbers] == counted


def test_publishers_are_counted_and_a_qos_that_does_not_match_is_named(graph):
    topic, node = f"{graph.namespace}/sensor", graph.node
    assert peers.in_words(node, [topic, "/gates"]) == f"{topic} or /gates (publishers: 0)"
    graph.collect_latched(String, topic)
    graph.latched(topic)
    graph.wait(lambda: peers.in_words(node, [topic]) == f"{topic} (publishers: 1)", "a latched publisher")
    node.create_publisher(String, topic, QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE))
    mismatch = "QoS does not match: Volatile publisher and transient local subscription"
    graph.wait(lambda: peers.in_words(node, [topic]) == f"{topic} (publishers: 2, {mismatch})", "another")
    name = f"{graph.namespace}/tester"[1:]
    assert peers.names(peers.publishers(node, [topic])) == peers.names(peers.readers(node, [topic])) == (name,)
