"""How a node's process starts, fails and ends, shown on a node made for it."""

import signal

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import PointCloud2

from srt3d_ros.messages.cdr import CloudMessage, Header

PROBE = """
import sys, time
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages.cdr import CloudMessage
from srt3d_ros.nodes.common.managed_node import ManagedNode
from srt3d_ros.nodes.common.process import run
from srt3d_ros.nodes.common.topics import NodeSpec, Topic

IN, OUT = Topic("in", "sensor_msgs/msg/PointCloud2", ""), Topic("out", "sensor_msgs/msg/PointCloud2", "")
RESUBSCRIBE, LINGER, HANG = 1000, 1001, 1002

class ProbeNode(ManagedNode):
    '''Does what the width of its message says: 0 fails, n works for n / 10 s, RESUBSCRIBE does so again and again,
    LINGER works until the node is inactive, HANG for ever.'''
    spec = NodeSpec("probe", [IN], [OUT])
    def __init__(self):
        super().__init__(queue_limit=8)
    def configure(self):
        self.publisher = self.endpoints.advertise(OUT)
        {start}
    def activate(self):
        self.subscribe(IN, self.on_message)
    def on_message(self, raw):
        cloud = CloudMessage.read(raw)
        if cloud.width == RESUBSCRIBE:
            sys.setswitchinterval(1e-5)     # to meet the race often
            for _ in range(500):
                self.unsubscribe()
                self.subscribe(IN, self.on_message)
            print("resubscribed", flush=True)
            return self.publish_frame(self.publisher, raw, cloud.header.stamp_ns)
        1 / cloud.width
        print("working", flush=True)
        while cloud.width == HANG or cloud.width == LINGER and self.state == "active":
            time.sleep(0.01)
        time.sleep(cloud.width / 10 if cloud.width < RESUBSCRIBE else 0)
        self.publish_frame(self.publisher, raw, cloud.header.stamp_ns)

sys.exit(run(ProbeNode))
"""


def message(width: int) -> bytes:
    return CloudMessage(Header(10**18, "x"), 1, width, (), False, 0, 0, memoryview(b""), True).write()


@pytest.fixture
def start(graph, tmp_path):
    """Starts the probe; `start` is a statement at the end of `configure`."""
    def start(*ros_args: str, start: str = "pass"):
        script = tmp_path / "probe.py"      # tracebacks show its lines
        script.write_text(PROBE.format(start=start))
        return graph.start("probe", *ros_args, code=f"import runpy; runpy.run_path({str(script)!r})")

    return start


def test_a_worker_may_replace_subscriptions_while_the_executor_waits_on_them(graph, start):
    probe = start().ready()
    publisher = graph.matched(graph.publisher(PointCloud2, "in"))
    publisher.publish(message(1000))
    graph.wait(lambda: probe.says("resubscribed") or not probe.running, "500 new subscriptions")
    graph.wait(lambda: publisher.get_subscription_count() == 1, "the last of them")
    publisher.publish(message(1))
    graph.wait(lambda: probe.says("working"), "a message on it")


def test_whatever_a_frame_or_a_callback_raises_is_counted_and_logged_once_and_the_node_goes_on(graph, start):
    probe = start(start="""self.create_timer(0.05, lambda: [].pop())
        self.endpoints.subscribe(IN, lambda message, info: {}["key"], 10)""").ready()
    publisher = graph.matched(graph.publisher(PointCloud2, "in"), subscribers=2)
    for width in (0, 0, 1):
        publisher.publish(message(width))
    report = graph.reports("probe", "frames_out", 1)
    assert (report["messages_in"], report["dropped"], report["dropped.internal"]) == ("3", "2", "2")
    graph.wait(lambda: graph.total("probe", "internal") > int(report["internal"]) + 1, "more failures of the timer")
    assert graph.report("probe")["last_error"] == "IndexError: pop from empty list"
    assert graph.report("probe")["level"] == DiagnosticStatus.ERROR
    assert [probe.text.count(text) for text in ("Trace", "1 / cloud.width", "[].pop()", '{}["key"]')] == [3, 1, 1, 1]
    assert graph.set("probe", unknown=3) != "" and probe.end(signal.SIGTERM) == 0


def test_nothing_is_published_after_a_deactivation_that_did_not_wait_for_a_long_frame(graph, start):
    clouds = graph.collect(PointCloud2, "out")
    probe = start(start="self.finish_s = 0.2").ready()
    publisher = graph.matched(graph.publisher(PointCloud2, "in"))
    publisher.publish(message(1001))
    probe.says("working")
    assert graph.change("probe", "deactivate")
    report = graph.reports("probe", "dropped.inactive", 1)
    assert (report["frames_out"], report["state"]) == ("0", "inactive")
    graph.wait(lambda: graph.change("probe", "activate"), "the next activation")
    graph.matched(publisher).publish(message(1))
    graph.reports("probe", "frames_out", 1)
    graph.wait(lambda: len(clouds) == 1, "its message alone")


def test_work_that_does_not_end_is_given_up_at_one_deadline_and_said(graph, start):
    probe = start(start="self.drain_s, self.finish_s = 0.1, 0.2").ready()
    publisher = graph.matched(graph.publisher(PointCloud2, "in"))
    for _ in range(3):
        publisher.publish(message(1002))
    graph.reports("probe", "messages_in", 3)
    probe.says("working")
    assert probe.end(signal.SIGTERM) == 1 and "2 messages still waited after 0.1 s: dropped (shutdown)" in probe.text
    graph.reports("probe", "dropped.shutdown", 3)


def test_a_signal_lets_the_current_frame_finish_and_the_accounting_adds_up(graph, start):
    clouds = graph.collect(PointCloud2, "out")
    probe = start().ready()
    publisher = graph.matched(graph.publisher(PointCloud2, "in"))
    for _ in range(8):
        publisher.publish(message(10))
    graph.reports("probe", "messages_in", 8)
    probe.says("working")
    assert probe.end(signal.SIGTERM) == 0
    report = graph.reports("probe", "state", "finalized")
    assert int(report["dropped.shutdown"]) == int(report["dropped"]) > 0
    graph.wait(lambda: len(clouds) == int(report["frames_out"]), "what was reported as sent")
    assert "Traceback" not in probe.text


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_long_start_also_if_a_compiler_swallows_what_it_raises(start, number):
    probe = start(start="""print('compiling', flush=True)
        while True:
            try:
                time.sleep(600)
            except BaseException:
                pass""").says("compiling")
    assert (probe.end(number), probe.lines) == (-number, ["compiling"])


QOS = "qos_overrides.{namespace}/in.subscription."


@pytest.mark.parametrize("ros_args, line", [
    (["-p", QOS + "reliability:=nonsense"], "Cannot use in: Unexpected QoS override for policy `reliability`: "),
    (["-r", "in:=/rosout"], "Cannot use /rosout as in: the node already uses it with another type"),
    (["--", "-p", "x:=5"], "-p x:=5: put --ros-args before arguments for ROS 2"),
])
def test_arguments_that_cannot_be_used_are_one_line_and_exit_code_2(graph, start, ros_args, line):
    probe = start(*(arg.format(namespace=graph.namespace) for arg in ros_args))
    assert probe.code() == 2
    line = f"srt3d: error: {line.format(namespace=graph.namespace)}"
    assert probe.lines[-1].startswith(line) and "Traceback" not in probe.text


def test_bad_input_or_a_log_that_cannot_be_written_is_one_line_and_a_mistake_of_ours_a_traceback(start, graph):
    probe = start(start="raise InvalidInput('thing', 3, '4')")
    assert (probe.code(), probe.lines) == (2, ["srt3d: error: thing is 3: expected 4"])
    probe = start(start="self.nothing")
    assert probe.code() == 1 and "AttributeError" in probe.text
    process = graph.start("player", code="import os; os.environ['ROS_LOG_DIR'] = '/proc/nowhere'")
    assert process.code() == 2 and "Traceback" not in process.text
    assert process.lines[-1].startswith("srt3d: error: ") and "directory '/proc/nowhere'" in process.lines[-1]
