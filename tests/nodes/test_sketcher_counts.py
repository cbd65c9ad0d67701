"""The counters of the sketcher: every packet and photon is published, or dropped for a cause in /diagnostics."""

import dataclasses
import itertools
import signal
import threading
import time

import numpy as np
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message

S, MS = 1_000_000_000, 1_000_000


def test_every_photon_is_sketched_or_dropped_for_a_cause_whatever_changes(graph, sensor, events):
    n = events.photons
    sketches = graph.collect(PointCloud2, "sketch")
    node = graph.start("sketcher", frame_period_s=0.1, use_sim_time=True, sketch_size=20).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    clock, seconds = graph.matched(graph.publisher(Clock, "/clock")), itertools.count(1)

    def send(*stamps_ms):
        for stamp in stamps_ms:
            frame = dataclasses.replace(events, stamp_ns=S + stamp * MS)
            photons.publish(photons_message.encode_cdr(frame, sensor, "spad"))

    def tick():
        """Another second passes."""
        clock.publish(Clock(clock=TimeMessage(sec=next(seconds))))
        return True

    send(0)                                                     # waits for the description
    described = graph.latched("sensor")
    described.publish(sensor_message.encode(sensor))
    graph.reports("sketcher", "num_bins", sensor.num_bins)
    send(50, 50, 100, 20, 200)                                  # one is double, one is late
    strangers = PhotonEvents(np.zeros(9, np.uint32), np.full(9, 700, np.uint16))
    photons.publish(photons_message.encode_cdr(strangers, sensor.replace(num_bins=1000), "spad"))
    photons.publish(photons_message.encode_cdr(events, sensor, "spad")[:-1000])     # fewer bytes than it says
    graph.reports("sketcher", "dropped.malformed", 2)
    assert graph.trigger("sketcher/reset")[0]
    graph.reports("sketcher", "dropped.incomplete", 1)
    send(300)
    graph.reports("sketcher", "packets_open", 1)
    described.publish(sensor_message.encode(sensor.replace(num_bins=20, irf=np.ones(3), irf_ref=1)))    # for m = 20
    graph.reports("sketcher", "last_error", "sketch_size is 20: expected 1 to 9 for T = 20 bins")
    send(400, 401)
    graph.reports("sketcher", "dropped.no_sensor", 2)
    described.publish(sensor_message.encode(sensor))
    graph.reports("sketcher", "num_bins", sensor.num_bins)
    send(1_000)
    graph.wait(lambda: tick() and len(sketches) == 4, "the frame that silence ends")
    send(1_500)
    graph.reports("sketcher", "packets_open", 1)
    assert node.end(signal.SIGINT) == 0
    last = graph.reports("sketcher", "state", "finalized")
    causes = {"no_sensor": (2, 2 * n), "duplicate": (1, n), "late": (1, n), "malformed": (2, 9), "incomplete": (1, n)}
    assert {key: (int(last[f"dropped.{key}"]), int(last[f"photons_dropped.{key}"])) for key in causes} == causes
    totals = {"frames_in": 13, "packets": 6, "photons_in": 11 * n + 9, "photons": 6 * n, "frames_out": 5, "errors": 1}
    assert {key: int(last[key]) for key in totals} == totals    # the open frame has ended with the node
    assert abs(float(last["latency_p50_ms"])) < 60_000          # by the simulated clock, which is near 0


def test_no_frame_is_lost_or_misread_while_gate_and_frequencies_change(graph, sensor, events):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor")
    graph.start("sketcher").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    settings = [{"gate": "30:79"}, {"frequencies": "1,2,5,9"}, {"gate": "off"}, {"frequencies": "auto"}]

    def send(stamp_ns):
        frame = dataclasses.replace(events, stamp_ns=stamp_ns)
        photons.publish(photons_message.encode_cdr(frame, sensor, "spad"))

    early = itertools.count()

    def found():
        """Whether the reconstructor has found the sketcher, whose sketches are lost until then."""
        send(next(early) * MS)
        time.sleep(0.1)
        return clouds

    graph.wait(found, "the first cloud")
    for k in range(24):
        if k % 6 == 3:
            assert graph.set("sketcher", **settings[k // 6]) == ""
        send(S + k * MS)
    late = {S + k * MS for k in range(24)}
    graph.wait(lambda: late <= {Time.from_msg(cloud.header.stamp).nanoseconds for cloud in clouds}, "24 clouds")
    for cloud in clouds:
        xyz = points_message.decode_cdr(serialize_message(cloud))[1]["xyz"]
        assert len(xyz) > 150
        assert abs(np.median(np.linalg.norm(xyz, axis=-1)) - sensor.range_m(50)) < sensor.bin_width_m
    report = graph.reports("sketcher", "frames_out", 24 + next(early))
    assert int(report["photons_dropped.gate"]) > 0 and report["dropped"] == "0"
    assert graph.reports("reconstructor", "frames_out", len(clouds))["dropped"] == "0"


def test_for_a_reader_that_halts_frames_are_merged_if_the_user_wants_it(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", frequencies="1,3", merge_when_busy=True).ready()
    reader = graph.start("reconstructor").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    graph.reports("reconstructor", "num_bins", sensor.num_bins)
    enough, sent = threading.Event(), []

    def send():
        while not enough.wait(0.02):
            sent.append(dataclasses.replace(events, stamp_ns=time.time_ns()))
            photons.publish(photons_message.encode_cdr(sent[-1], sensor, "spad"))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        graph.wait(lambda: sketches, "a sketch")
        reader.halt()
        graph.wait(lambda: len(sent) > 60, "60 frames")
        reader.go_on()
    finally:
        enough.set()
        sender.join()

    def is_settled():       # a process that is halted may hold up the one that sends, which then loses photons
        return len(sent) == sum(graph.total("sketcher", name) for name in ("packets", "dropped", "message_lost"))

    graph.wait(is_settled, "all that was sent")
    packets = graph.total("sketcher", "packets")
    graph.wait(lambda: len(sketches) == graph.total("sketcher", "frames_out"), "the sketches")
    decoded = [sketch_message.decode_cdr(serialize_message(message), sensor)[1] for message in sketches]
    assert sum(int(sketch.photons.sum()) for sketch in decoded) == packets * events.photons
    assert len(sketches) < packets
