"""/diagnostics: totals, and levels that follow from them. tests/docs has what the middleware says."""

from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from srt3d_ros.nodes.common import diagnostics as module
from srt3d_ros.nodes.common.diagnostics import Diagnostics

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@pytest.fixture
def counted(graph):
    """Diagnostics of a node "counted", a function that reports and gives back what arrived, and the node."""
    node = Node("counted", namespace=graph.namespace)
    diagnostics = Diagnostics(node)
    diagnostics.state = "active"
    graph.wait(lambda: node.count_subscribers("/diagnostics"), "a subscriber")
    graph.matched(diagnostics.publisher)

    def latest() -> dict:
        before = len(graph.all_reports("counted"))
        diagnostics.report()
        graph.wait(lambda: len(graph.all_reports("counted")) > before, "the report")
        return graph.report("counted")

    yield diagnostics, latest, node
    node.destroy_node()


def test_totals_and_drops_by_cause_go_on_and_rates_start_again(counted):
    diagnostics, latest, _ = counted
    for _ in range(5):
        diagnostics.received()
    for milliseconds in (10, 20, 30):
        diagnostics.sent(milliseconds * 1e-3)
    diagnostics.drop("queue")
    diagnostics.drop("malformed")
    diagnostics.count(photons=1000)
    diagnostics.show(device="cpu")
    first, second = latest(), latest()
    for report in (first, second):
        assert (report["messages_in"], report["frames_out"], report["photons"]) == ("5", "3", "1000")
        assert (report["dropped"], report["dropped.queue"], report["dropped.malformed"]) == ("2", "1", "1")
        assert "photons_dropped" not in report
        assert (report["latency_p50_ms"], report["latency_p95_ms"], report["device"]) == ("20.00", "29.00", "cpu")
    assert float(first["rate_in_hz"]) > 0 and second["rate_in_hz"] == second["rate_out_hz"] == "0.00"


def test_levels_follow_what_happened_since_the_last_report(counted, monkeypatch):
    diagnostics, latest, _ = counted

    def receive(frames: int, **others: int) -> None:
        for _ in range(frames):
            diagnostics.received()
        diagnostics.count(**others)

    def says(level: bytes, words: str) -> None:
        report = latest()
        assert report["level"] == level and words in report["message"], report

    says(OK, "0.0 messages/s in, 0.0 out")
    diagnostics.wait_for("the sensor")
    says(WARN, "waiting for the sensor for 0 s")
    assert latest()["waiting_for"] == "the sensor" and float(latest()["waiting_s"]) < 60
    diagnostics.wait_for("")
    receive(2)
    diagnostics.sent(0.01)
    diagnostics.drop("queue")
    says(WARN, "dropped: 1 queue, of 2")
    receive(1)
    diagnostics.drop("malformed")
    says(ERROR, "dropped: 1 malformed, of 1")
    diagnostics.failed(KeyError("x"))
    says(ERROR, "KeyError: 'x'")
    says(ERROR, "KeyError: 'x'")        # as long as no frame leaves; the next may pass
    assert latest()["ready"] == "True"
    diagnostics.sent(0.01)
    receive(2, message_lost=2)
    says(WARN, "dropped: 2 lost on the way here, of 4")
    receive(0, message_lost=3)
    says(ERROR, "dropped: 3 lost on the way here, of 3")
    diagnostics.failed(KeyError("x"))
    diagnostics.clear()                         # as an activation does
    says(ERROR, "KeyError: 'x'")                # once
    says(OK, "0.0 messages/s in, 0.0 out")
    diagnostics.error("ZeroDivisionError: division by zero")
    says(ERROR, "ZeroDivisionError: division by zero")
    diagnostics.warn("late: skipped 3 frames")
    says(WARN, "late: skipped 3 frames")        # once
    diagnostics.problem = "rows is 3: expected 4"
    for _ in range(2):                          # as long as it lasts
        says(ERROR, "rows is 3: expected 4")
    assert latest()["ready"] == "False"
    diagnostics.problem = ""
    report = latest()
    assert (report["level"], report["last_error"]) == (OK, "ZeroDivisionError: division by zero")
    assert (latest()["waiting_for"], latest()["ready"]) == ("", "True")
    for cause, text, changes in (("motion", "frames go on undeskewed", True), ("light", "saturated pixels: 3", True),
                                 ("light", "saturated pixels: 4", False), ("motion", "", True), ("motion", "", False)):
        assert diagnostics.degrade(cause, text) is changes
        diagnostics.sent(0.01)
        says(WARN, text)
    says(WARN, "saturated pixels: 4")
    diagnostics.begin()
    monkeypatch.setattr(module, "PATIENCE_S", -1.0)
    for topic in ("/photons", "/gates", "/histograms"):
        diagnostics.expect(topic)
    says(WARN, "waiting for a frame on /photons, /gates or /histograms (publishers: 0) for 0 s")
    monkeypatch.setattr(module, "PATIENCE_S", 60.0)
    receive(1)
    says(OK, "messages/s in")
    for latency_s, words in ((66.4, "frames are 66.4 s old: behind"),
                             (86400, "frames are 86400.0 s old: stamped by another clock"),
                             (-3600, "frames are stamped 3600.0 s ahead of this node's clock")):
        receive(1)
        diagnostics.sent(latency_s)
        says(WARN, words)
    receive(1)
    diagnostics.sent(-0.1)          # as far as clocks may be apart
    says(OK, "messages/s in")
    diagnostics.state = "inactive"
    says(OK, "inactive")


def test_losses_are_logged_once_a_minute_and_at_the_end(graph, counted):
    diagnostics, latest, node = counted
    log = graph.collect_latched(Log, "/rosout")

    def lines() -> list[str]:
        return [line.msg for line in log if line.name == node.get_logger().name and line.msg.startswith("dropped")]

    for count in (5, 3):
        diagnostics.count(messages_in=count, message_lost=1)
        diagnostics.drop("queue", 2)
        diagnostics.drop("shutdown")
        latest()
        graph.wait(lines, "the first line")
    diagnostics.close()
    graph.wait(lambda: len(lines()) == 2, "the last line")
    assert lines() == ["dropped 3 of 6 messages since the start: 2 queue, 1 lost on the way here",
                       "dropped 3 of 4 messages since the last such line: 2 queue, 1 lost on the way here"]


def test_a_status_says_how_long_its_level_has_lasted(counted, monkeypatch):
    diagnostics, latest, _ = counted
    now_s = module.time.monotonic()
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now_s))
    since = []
    for problem, later_s in (("", 1e6), ("x", 5), ("y", 5), ("", 5), ("", 5)):
        diagnostics.problem, now_s = problem, now_s + later_s
        since.append(float(latest()["since_s"]))
    assert since[1:] == [0, 5, 0, 5] and since[0] >= 1e6


def test_simulated_time_without_a_clock_is_a_warning_from_when_it_is_asked_for(graph, counted, monkeypatch):
    _, latest, node = counted
    now_s = module.time.monotonic() + 3600      # an hour after the node's start
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now_s))
    assert latest()["level"] == OK
    node.set_parameters([Parameter("use_sim_time", value=True)])
    report = latest()
    assert report["level"] == WARN and report["message"] == "waiting for /clock (use_sim_time is true) for 0 s"
    now_s += 3
    assert latest()["message"].endswith(" for 3 s")
    publisher = graph.matched(graph.node.create_publisher(Clock, "/clock", 1))
    publisher.publish(Clock(clock=Time(sec=5)))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    graph.wait(lambda: executor.spin_once(0.01) or node.get_clock().now().nanoseconds, "simulated time")
    assert latest()["level"] == OK
