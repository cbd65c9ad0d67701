"""The counters of the sketcher: every packet and photon is published, or dropped for a cause in /diagnostics."""

import signal

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr, sensor_message, sketch_message

S, MS = 1_000_000_000, 1_000_000


def test_every_photon_is_sketched_or_dropped_for_a_cause_and_a_bad_description_is_an_error_until_a_good_one_comes(
        graph, sensor, events, photons_at):
    n = events.photons
    sketches = graph.collect(PointCloud2, "sketch")
    node = graph.start("sketcher", frame_period_s=0.1, sketch_size=20).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))

    def send(*stamps_ms):
        for stamp in stamps_ms:
            photons.publish(photons_at(S + stamp * MS))

    send(0)                                                     # waits for the description
    described = graph.latched("sensor")
    described.publish(sensor_message.encode(sensor))
    send(50, 100, 20, 200)                                      # one is late
    photons.publish(photons_at(S)[:-1000])                      # fewer bytes than it says
    graph.reports("sketcher", "dropped.malformed", 1)
    send(300)
    graph.wait(lambda: len(sketches) == 4, "the frame that silence ends")
    send(400)                                                   # its frame is open when another sensor is described
    graph.reports("sketcher", "messages_in", 8)
    for text, problem in (('{"rows": 0}', "schema_version is absent: expected 1"),
                          (sensor_message.encode(sensor.replace(num_bins=20, irf=np.ones(3), irf_ref=1)).data,
                           "sketch_size is 20: expected 1 to 9 for T = 20 bins")):
        described.publish(String(data=text))
        graph.wait(lambda problem=problem: graph.report("sketcher")["message"].startswith(problem), problem)
        send(500, 501)
        report = graph.next_reports("sketcher", 3)[-1]
        assert (report["level"], report["message"][:len(problem)]) == (DiagnosticStatus.ERROR, problem)
    graph.reports("sketcher", "dropped.no_sensor", 4)
    described.publish(sensor_message.encode(sensor))
    graph.wait(lambda: graph.report("sketcher")["level"] != DiagnosticStatus.ERROR, "the end of the error")
    send(1_500)
    graph.reports("sketcher", "packets", 6)
    assert node.end(signal.SIGINT) == 0
    last = graph.reports("sketcher", "state", "finalized")
    causes = {"no_sensor": (4, 0), "late": (1, n), "malformed": (1, 0), "incomplete": (1, n)}
    assert {key: (int(last[f"dropped.{key}"]), int(last.get(f"photons_dropped.{key}", 0))) for key in causes} == causes


def test_a_driver_of_best_effort_is_read_whenever_it_comes_and_not_in_spite_of_the_user(graph, sensor, photons_at):
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    described.publish(sensor_message.encode(sensor))
    first = graph.start("sketcher").ready()

    def drive():
        """A driver that comes and sends until there is a sketch."""
        driver = graph.node.create_publisher(PointCloud2, "photons", qos_profile_sensor_data)
        before = len(sketches)
        graph.wait(lambda: driver.publish(photons_at(S)) or len(sketches) > before, "a sketch of the driver's")

    drive()
    assert "incompatible" not in first.text
    first.end(signal.SIGTERM)
    graph.start("sketcher").ready()         # the driver is there
    drive()
    stubborn = graph.start("sketcher", "-r", "__node:=stubborn", "-p",
                           f"qos_overrides.{graph.namespace}/photons.subscription.reliability:=reliable")
    stubborn.says(f"New publisher discovered on topic '{graph.namespace}/photons', offering incompatible QoS")
    stubborn.says("waiting for a frame on ")


def test_no_frame_is_lost_while_gate_and_frequencies_change_and_each_names_its_description(graph, sensor, photons_at):
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.collect_latched(String, "sketch/sensor")
    graph.start("sketcher", frequencies="1,3").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    graph.known_to("sketcher")
    settings = [{"gate": "30-79"}, {"frequencies": "1,2,5,9"}, {"gate": "off"}, {"frequencies": "auto"}]
    for k in range(24):
        graph.wait(lambda k=k: len(sketches) > k - 4, "all but the last three sketches")
        if k % 6 == 3:
            assert graph.set("sketcher", **settings[k // 6]) == ""
        photons.publish(photons_at(S + k * MS))
    graph.wait(lambda: len(sketches) == 24, "24 sketches")
    sensors = {sensor_message.digest(one.data): sensor_message.from_json(one.data) for one in described}
    depths = []
    for raw in map(serialize_message, sketches):
        _, sketch = sketch_message.decode_cdr(raw, sensors[sketch_message.description_of(cdr.read_cloud(raw))])
        mean = sketch.sums[..., 0].sum()                # of frequency 1
        depths.append(np.angle(mean) / (2 * np.pi) * sketch.sensor.num_bins % sketch.sensor.num_bins
                      + sketch.sensor.toa_offset_bins)
    np.testing.assert_allclose(depths, 50, atol=1)
    assert len({sketch.fields[-1].name for sketch in sketches}) == 2
    report = graph.reports("sketcher", "frames_out", 24)
    assert int(report["photons_dropped.gate"]) > 0 and report["dropped"] == "0"
