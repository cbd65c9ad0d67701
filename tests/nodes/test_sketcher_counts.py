"""Nothing is lost in the sketcher: every packet and photon is sketched or dropped for a cause."""

import dataclasses
import itertools
import signal
import time

import numpy as np
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message

S = 1_000_000_000


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
    send(400, 401)
    graph.reports("sketcher", "dropped.no_sensor", 2)
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
