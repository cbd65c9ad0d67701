"""Nothing is lost: what came into a node went out, was dropped for a cause, or is under way; and it says so itself."""

import dataclasses
import itertools
import signal
import time

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages.cdr import Cloud, Header, write_cloud
from tests.nodes.conftest import Graph, check_accounts

S = 1_000_000_000
LOSER = """
import sys
from srt3d_ros.messages.cdr import read_cloud
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.topics import Topic

CLOUD = "sensor_msgs/msg/PointCloud2"

class LoserNode(PipelineNode):
    '''Passes frames on, but forgets to say what became of those of width 7.'''
    spec = NodeSpec("loser", [Topic("in", CLOUD, "")], [Topic("out", CLOUD, "")])
    def configure(self):
        self.publisher = self.advertise("out")
    def activate(self):
        self.subscribe("in", self.on_message)
    def on_message(self, raw):
        if read_cloud(raw).width != 7:
            self.publish_frame(self.publisher, raw, 0)

sys.exit(run(LoserNode))
"""


def test_a_node_that_loses_a_frame_says_so_and_fails_the_test_in_which_it_does(ros, tmp_path):
    graph = Graph()
    try:
        script = tmp_path / "loser.py"
        script.write_text(LOSER)
        graph.start(str(script)).ready()
        publisher = graph.matched(graph.publisher(PointCloud2, "in"))
        for width in (1, 7, 1):
            publisher.publish(write_cloud(Cloud(Header(0, "x"), 1, width, (), False, 0, 0, memoryview(b""), True)))
        report = graph.reports("loser", "frames_out", 2)
        assert (report["frames_in"], report["under_way"], report["unaccounted_frames"]) == ("3", "0", "1")
        errors = [report for report in graph.all_reports("loser") if report["level"] == DiagnosticStatus.ERROR]
        assert [report["message"] for report in errors] == ["frame accounting does not add up: unaccounted_frames 1"]
    finally:
        with pytest.raises(AssertionError, match="accounting of loser does not add up: {'unaccounted_frames': '1'}"):
            graph.close()
    honest = graph.report("loser") | {"unaccounted_frames": "0"}
    with pytest.raises(AssertionError, match=r"loser ended: expected 3 = 2 \+ 0"):
        check_accounts("loser", "loser", [honest], ended=True)


def test_a_lossless_node_keeps_its_photons_until_they_are_described_and_sketches_until_somebody_subscribes(
        graph, sensor, events):
    node = graph.start("sketcher", lossless=True).ready()
    photons, described = graph.matched(graph.publisher(PointCloud2, "photons")), graph.latched("sensor")

    def send(stamps_ns: range) -> None:
        for stamp_ns in stamps_ns:
            frame = dataclasses.replace(events, stamp_ns=stamp_ns)
            photons.publish(photons_message.encode_cdr(frame, sensor, "spad"))

    send(range(20))
    graph.reports("sketcher", "frames_in", 20)
    assert graph.report("sketcher")["message"] == "waiting for a sensor description on sensor"
    described.publish(String(data="{}"))
    waiting = "waiting for a sensor description on sensor that can be used: "
    graph.wait(lambda: graph.report("sketcher")["message"].startswith(waiting), "the reason")
    described.publish(sensor_message.encode(sensor))
    node.says("waiting for a subscriber on")
    sketches = graph.node.create_subscription(PointCloud2, "sketch", (received := []).append, 100)
    graph.wait(lambda: len(received) == 20, "all 20 sketches")
    assert graph.reports("sketcher", "frames_out", 20)["dropped"] == "0"
    graph.node.destroy_subscription(sketches)
    graph.known_to("sketcher")
    send(range(20, 25))
    graph.reports("sketcher", "under_way", 5)
    assert node.end(signal.SIGTERM) == 0
    last = graph.reports("sketcher", "state", "finalized")
    expected = {"frames_in": 25, "frames_out": 20, "dropped.shutdown": 5, "dropped": 5, "under_way": 0,
                "photons_dropped.shutdown": 5 * events.photons, "photons_under_way": 0, "errors": 1}
    assert {key: int(last[key]) for key in expected} == expected


def test_every_photon_is_sketched_or_dropped_for_a_cause_whatever_changes(graph, sensor, events):
    n, sent = events.photons, 0
    sketches, described_as = graph.collect(PointCloud2, "sketch"), graph.collect_latched(String, "sketch/sensor")
    node = graph.start("sketcher", frame_period_s=0.1, use_sim_time=True, sketch_size=20).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    images = {topic: graph.matched(graph.publisher(Image, topic)) for topic in ("gates", "histograms")}
    clock, seconds = graph.matched(graph.publisher(Clock, "/clock")), itertools.count(1)

    def send(*stamps_ms):
        nonlocal sent
        for stamp in stamps_ms:
            frame = dataclasses.replace(events, stamp_ns=S + stamp * 1_000_000)
            photons.publish(photons_message.encode_cdr(frame, sensor, "spad"))
        sent += len(stamps_ms)

    def tick():
        """Another second passes."""
        clock.publish(Clock(clock=Time(sec=next(seconds))))
        return True

    def send_image(topic, stamp_ms):
        frame = dataclasses.replace(events, stamp_ns=S + stamp_ms * 1_000_000)
        images[topic].publish(photon_frames.encode_cdr(frame, topic, sensor))

    send(0, 1)                                                  # nobody knows the sensor
    graph.reports("sketcher", "dropped.no_sensor", 2)
    described = graph.latched("sensor")
    described.publish(sensor_message.encode(sensor))
    graph.reports("sketcher", "num_bins", sensor.num_bins)
    send(0, 50, 50, 100, 20, 200)                               # one is double, one is late
    strangers = PhotonEvents(np.zeros(9, np.uint32), np.full(9, 700, np.uint16))
    photons.publish(photons_message.encode_cdr(strangers, sensor.replace(num_bins=1000), "spad"))
    photons.publish(photons_message.encode_cdr(events, sensor, "spad")[:-1000])     # fewer bytes than it says
    graph.reports("sketcher", "dropped.malformed", 2)
    graph.wait(lambda: len(sketches) == 2, "two frames")
    assert graph.trigger("sketcher/reset")[0]
    graph.reports("sketcher", "packets_open", 0)
    send(300)
    graph.reports("sketcher", "packets_open", 1)
    described.publish(sensor_message.encode(sensor.replace(num_bins=20, irf=np.ones(3), irf_ref=1)))    # for m = 20
    graph.reports("sketcher", "last_error", "sketch_size is 20: expected 1 to 9 for T = 20 bins")
    graph.reports("sketcher", "packets_open", 0)
    for _ in range(10):                                         # silence, but nothing to end the frame with
        assert tick()
        time.sleep(0.02)
    described.publish(sensor_message.encode(sensor))
    graph.wait(lambda: len(described_as) == 2, "the sketch of the sensor")
    for number, topic in enumerate(images, 1):
        send_image(topic, 1000)
        graph.reports("sketcher", "packets_open", number)
    graph.wait(lambda: tick() and len(sketches) == 3, "the frame that silence ends")
    for number, topic in enumerate(images, 2):                  # late, and counted as they are read
        send_image(topic, 1000)
        graph.reports("sketcher", "dropped.late", number)
    assert node.end(signal.SIGINT) == 0
    last = graph.reports("sketcher", "state", "finalized")
    causes = {"no_sensor": (2, 2 * n), "duplicate": (1, n), "late": (3, 3 * n), "malformed": (2, 9),
              "incomplete": (2, 2 * n)}
    assert {key: (int(last[f"dropped.{key}"]), int(last[f"photons_dropped.{key}"])) for key in causes} == causes
    totals = {"frames_in": sent + 6, "packets": 5, "photons_in": (sent + 4) * n + 9, "photons": 5 * n, "frames_out": 3,
              "under_way": 0, "photons_under_way": 0, "errors": 1}       # one error: the description
    assert {key: int(last[key]) for key in totals} == totals
    assert abs(float(last["latency_p50_ms"])) < 60_000          # by the simulated clock, which is near 0
