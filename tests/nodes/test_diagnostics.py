"""/diagnostics: totals that balance, levels that follow from them."""

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from srt3d_ros.nodes import diagnostics as module
from srt3d_ros.nodes.diagnostics import Diagnostics
from srt3d_ros.nodes.lifecycle import ManagedNode


@pytest.fixture
def counted(graph):
    """Diagnostics of a node "counted", a function that reports and gives back what arrived, and the node."""
    node = ManagedNode("counted", namespace=graph.namespace)
    node.state = "active"
    diagnostics = Diagnostics(node)
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
        assert (report["frames_in"], report["frames_out"], report["photons"]) == ("5", "3", "1000")
        assert (report["dropped"], report["dropped.queue"], report["dropped.malformed"]) == ("2", "1", "1")
        assert (report["latency_p50_ms"], report["latency_p95_ms"], report["device"]) == ("20.00", "29.00", "cpu")
    assert float(first["rate_in_hz"]) > 0 and second["rate_in_hz"] == second["rate_out_hz"] == "0.00"


def test_levels_follow_what_happened_since_the_last_report(counted):
    diagnostics, latest, _ = counted
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
    diagnostics.received()
    diagnostics.received()
    diagnostics.count(message_lost=2)
    assert level() == DiagnosticStatus.WARN
    diagnostics.count(message_lost=3)
    assert level() == DiagnosticStatus.ERROR
    diagnostics.error("ZeroDivisionError: division by zero")
    assert level() == DiagnosticStatus.ERROR
    assert level() == DiagnosticStatus.OK
    assert seen[1:7] == ["waiting for the sensor", "dropped: 1 queue, of 2", "dropped: 1 malformed, of 1",
                         "dropped: 2 lost on the way here, of 4", "dropped: 3 lost on the way here, of 3",
                         "ZeroDivisionError: division by zero"]
    assert latest()["last_error"] == "ZeroDivisionError: division by zero"


def test_accounting_that_does_not_add_up_is_an_error_once_and_stays_in_the_report(counted):
    diagnostics, latest, _ = counted
    for _ in range(4):
        diagnostics.received()
    diagnostics.sent(0.01)
    diagnostics.drop("queue")
    diagnostics.audit(frames=2, photons=0)
    report = latest()
    assert (report["under_way"], report["unaccounted_frames"], report["level"]) == ("2", "0", DiagnosticStatus.WARN)
    diagnostics.audit(frames=1, photons=0)
    report = latest()
    assert (report["under_way"], report["unaccounted_frames"], report["level"]) == ("1", "1", DiagnosticStatus.ERROR)
    assert report["message"] == "frame accounting does not add up: unaccounted_frames 1"
    report = latest()
    assert (report["unaccounted_frames"], report["level"]) == ("1", DiagnosticStatus.OK)


def test_the_warning_of_untimely_frames_ends_with_its_cause(counted):
    diagnostics, latest, _ = counted
    for latency_s, message in ((66.4, "frames are 66.4 s old: behind, or stamped by another clock"),
                               (-3600, "frames are stamped 3600.0 s ahead of this node's clock: by another clock, "
                                       "unknown to tf")):
        for _ in range(150):
            diagnostics.received()
            diagnostics.sent(latency_s)
        report = latest()
        assert (report["level"], report["message"]) == (DiagnosticStatus.WARN, message)
        diagnostics.received()
        diagnostics.sent(0.01)
        report = latest()
        assert report["level"] == DiagnosticStatus.OK, report["message"]
        assert float(report["latency_p50_ms"]) == 1e3 * latency_s       # of the newest 200, most of them untimely
    diagnostics.sent(-0.1)          # as far as clocks may be apart
    assert latest()["level"] == DiagnosticStatus.OK


def test_simulated_time_without_a_clock_is_a_warning(graph, counted):
    _, latest, node = counted
    node.set_parameters([Parameter("use_sim_time", value=True)])
    report = latest()
    assert (report["level"], report["message"]) == (
        DiagnosticStatus.WARN, "use_sim_time is true, but nobody publishes /clock")
    publisher = graph.matched(graph.node.create_publisher(Clock, "/clock", 1))
    graph.wait(lambda: node.count_publishers("/clock"), "the clock's publisher")
    assert latest()["message"] == "use_sim_time is true and 1 publishes /clock, but the clock stands at 0"
    publisher.publish(Clock(clock=Time(sec=5)))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    graph.wait(lambda: executor.spin_once(0.01) or node.get_clock().now().nanoseconds, "simulated time")
    executor.remove_node(node)
    assert latest()["level"] == DiagnosticStatus.OK
    graph.node.destroy_publisher(publisher)
    graph.wait(lambda: not node.count_publishers("/clock"), "the end of the clock")
    assert latest()["message"] == "use_sim_time is true, but nobody publishes /clock"


def test_a_contradiction_is_an_error_as_long_as_it_lasts(counted):
    diagnostics, latest, _ = counted
    found = ["rows is 3: expected 4"]
    diagnostics.find_contradiction = lambda: found[0]
    for _ in range(2):
        report = latest()
        assert (report["level"], report["message"]) == (DiagnosticStatus.ERROR, "rows is 3: expected 4")
    found[0] = ""
    assert latest()["level"] == DiagnosticStatus.OK


def test_silence_is_a_warning_and_a_node_that_is_not_active_is_well(graph, counted, monkeypatch):
    diagnostics, latest, node = counted
    monkeypatch.setattr(module, "SILENCE_S", 0.0)
    assert latest()["level"] == DiagnosticStatus.OK         # nothing is to come
    diagnostics.expect("/photons", "sensor_msgs/msg/PointCloud2")
    diagnostics.expect("/gates", "std_msgs/msg/String")
    publisher = node.create_publisher(String, "/gates", 1)
    graph.wait(lambda: node.count_publishers("/gates"), "the publisher")
    report = latest()
    assert report["level"] == DiagnosticStatus.WARN
    assert report["message"] == "no frame yet: nobody publishes /photons, 1 publishes /gates"
    diagnostics.expect("/gates", "sensor_msgs/msg/Image")
    assert latest()["message"].endswith(
        "nobody publishes /gates (but there is std_msgs/msg/String: expected sensor_msgs/msg/Image)")
    second = node.create_publisher(String, "/gates", 1)
    graph.wait(lambda: node.count_publishers("/gates") == 2, "the second publisher")
    diagnostics.received()
    diagnostics.drop("late")
    assert latest()["message"] == "dropped: 1 late, of 1; 2 publish /gates"
    for one in (publisher, second):
        node.destroy_publisher(one)
    diagnostics.received()
    report = latest()
    assert report["level"] == DiagnosticStatus.WARN and report["message"].startswith("no frame for ")
    node.state = "inactive"
    report = latest()
    assert (report["level"], report["message"], report["state"]) == (DiagnosticStatus.OK, "inactive", "inactive")
