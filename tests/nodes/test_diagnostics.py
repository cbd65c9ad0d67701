"""/diagnostics: totals that balance, levels that follow from them."""

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus

from srt3d_ros.nodes.diagnostics import Diagnostics


@pytest.fixture
def counted(graph):
    """Diagnostics of a node "counted", and a function that reports and gives back what arrived."""
    node = rclpy.create_node("counted", namespace=graph.namespace)
    diagnostics = Diagnostics(node)
    graph.wait(lambda: node.count_subscribers("/diagnostics"), "a subscriber")
    graph.matched(diagnostics.publisher)

    def latest() -> dict:
        before = len(graph.all_reports("counted"))
        diagnostics.report()
        graph.wait(lambda: len(graph.all_reports("counted")) > before, "the report")
        return graph.report("counted")

    yield diagnostics, latest
    node.destroy_node()


def test_totals_and_drops_by_cause_go_on_and_rates_start_again(counted):
    diagnostics, latest = counted
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
        assert (report["frames_in"], report["frames_out"], report["photons"]) == ("5", "3", "1000")
        assert (report["dropped"], report["dropped.queue"], report["dropped.malformed"]) == ("2", "1", "1")
        assert (report["latency_p50_ms"], report["latency_p95_ms"], report["device"]) == ("20.00", "29.00", "cpu")
    assert float(first["rate_in_hz"]) > 0 and second["rate_in_hz"] == second["rate_out_hz"] == "0.00"


def test_levels_follow_what_happened_since_the_last_report(counted):
    diagnostics, latest = counted
    seen = []

    def level():
        report = latest()
        seen.append(report["message"])
        return report["level"]

    assert level() == DiagnosticStatus.OK
    diagnostics.wait_for("the sensor")
    assert level() == DiagnosticStatus.WARN
    diagnostics.wait_for("")
    diagnostics.received()
    diagnostics.received()
    diagnostics.sent(0.01)
    diagnostics.drop("queue")
    assert level() == DiagnosticStatus.WARN
    diagnostics.received()
    diagnostics.drop("malformed")
    assert level() == DiagnosticStatus.ERROR
    diagnostics.lost(3)
    assert level() == DiagnosticStatus.WARN
    diagnostics.error("ZeroDivisionError: division by zero")
    assert level() == DiagnosticStatus.ERROR
    assert level() == DiagnosticStatus.OK
    assert seen[1:6] == ["waiting for the sensor", "dropped: 1 queue", "every frame dropped: 1 malformed",
                         "3 messages lost on the way here", "ZeroDivisionError: division by zero"]
    assert latest()["last_error"] == "ZeroDivisionError: division by zero"
