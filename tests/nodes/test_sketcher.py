"""The sketcher alone: what it publishes, what it follows, what it refuses."""

import dataclasses

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.messages import cdr, photon_frames, sensor_message, sketch_message
from tests.photon_forms import as_gates, as_histograms

STAMP_NS = 1_700_000_000_123_456_789
ATTEMPTS = 5            # to have a description overtake frames


def test_sketches_are_the_cores_in_all_forms_and_follow_the_parameters(graph, sensor, events, photons_at):
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.collect_latched(String, "sketch/sensor")
    durability = f"qos_overrides.{graph.namespace}/sketch.publisher.durability:=TRANSIENT_LOCAL"
    node = graph.start("sketcher", "-p", durability, sketch_sise=3, frequencies="1,3").ready()
    writer, = graph.wait(lambda: graph.node.get_publishers_info_by_topic("sketch"), "the publisher of sketch")
    assert writer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert "sketcher has no such parameter, did you mean sketch_size?" in node.text
    graph.introduce(sensor)
    publishers = {topic: graph.matched(graph.publisher(PointCloud2 if topic == "photons" else Image, topic))
                  for topic in photon_frames.CODECS}

    def sketch_of(raw: bytes, topic: str = "photons"):
        """Header and sketch of a message."""
        sketches.clear()
        publishers[topic].publish(raw)
        graph.wait(lambda: sketches, "a sketch")
        raw = serialize_message(sketches[0])
        sensors = {sensor_message.digest(one.data): sensor_message.from_json(one.data) for one in described}
        return sketch_message.decode_cdr(raw, sensors[sketch_message.description_of(cdr.read_cloud(raw))])

    assert graph.set("sketcher", gate="30-69") == ""
    graph.reports("sketcher", "gate", "30-69, 0.4497 to 1.034 m")
    expected = sketch_photons(events, sensor, (1, 3), Gate(sensor, 30, 69))
    for k, (topic, codec) in enumerate(photon_frames.CODECS.items()):
        frame = dataclasses.replace(events, stamp_ns=STAMP_NS + k)
        frame = {"gates": as_gates, "histograms": as_histograms}.get(topic, lambda events, _: events)(frame, sensor)
        header, sketch = sketch_of(codec.encode_cdr(frame, sensor, sensor.frame_id), topic)
        assert (header.stamp_ns, header.frame_id) == (STAMP_NS + k, sensor.frame_id)
        np.testing.assert_array_equal(sketch.photons, expected.photons)
        np.testing.assert_allclose(sketch.sums, expected.sums, atol=1e-2)
        assert sketch.cycles == (len(frame.words) if topic == "gates" else 0)
    report = graph.reports("sketcher", "frames_out", 3)
    outside = int(report["photons_dropped.gate"])
    assert [int(report[key]) for key in ("photons_in", "photons")] == [3 * events.photons, 3 * events.photons - outside]

    live = {"frequencies": "1,4,9", "packets_per_frame": 1, "layout": "int16", "frame_id": "mast", "gate": False}
    assert graph.set("sketcher", **live) == ""
    graph.reports("sketcher", "frequencies", "1 4 9")
    header, sketch = sketch_of(photons_at(STAMP_NS + 3))
    assert (header.frame_id, sketch.frequencies, sketches[0].point_step) == ("mast", (1, 4, 9), 4 + 4 * 3)
    for name, value, shown in (("gate", [40, 89], "40-89, 0.5996 to 1.334 m"), ("gate", False, "off"),      # YAML's off
                               ("frequencies", [1, 2, 5], "1 2 5"), ("frequencies", 3, "3")):
        assert graph.set("sketcher", **{name: value}) == ""
        graph.reports("sketcher", name, shown)
    for values, reason in (({"frequencies": "auto", "sketch_size": 60}, "sketch_size is 60: expected 1 to 49 for T"),
                           ({"frequencies": "1,50"}, "frequencies is 50: expected integers from 1 to 49"),
                           ({"frequencies": "48,49"}, "frequencies is [48, 49]: expected some that the sensor's IRF"),
                           ({"frequencies": "banana"}, "frequencies is banana: expected auto"),
                           ({"gate": "50:60"}, "gate is 50-60: expected 15 bins or more, as many as the IRF has"),
                           ({"gate": True}, "gate is True: expected off, or first and last bin such as 100-400"),
                           ({"packets_per_frame": 0}, "packets_per_frame out of range"),
                           ({"sensor_file": "a.json"}, "read-only")):
        assert reason in graph.set("sketcher", **values)
    assert graph.report("sketcher")["errors"] == "0"


def test_a_parameter_that_does_not_suit_the_sensor_is_an_error_until_it_is_corrected(graph, sensor, photons_at):
    """The gate lies outside; the nodes behind it, and a player, wait until the sketcher is ready."""
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    described.publish(sensor_message.encode(sensor))
    node = graph.start("sketcher", gate="500-600").ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    node.says(problem := "gate is 500-600: expected ")
    graph.wait(lambda: (report := graph.report("sketcher"))["level"] == DiagnosticStatus.ERROR
               and report["message"].startswith(problem) and report["errors"] == "1", "the error, as long as it lasts")
    assert graph.set("sketcher", gate="off") == ""
    graph.reports("sketcher", "ready", True)
    assert graph.report("sketcher")["level"] != DiagnosticStatus.ERROR
    described.publish(String(data="{"))
    graph.wait(lambda: graph.report("sketcher")["level"] == DiagnosticStatus.ERROR, "another error")
    assert graph.set("sketcher", frequencies="consecutive") == ""     # which does not make the description a good one
    graph.known_to("sketcher")
    photons.publish(photons_at(STAMP_NS))
    assert graph.reports("sketcher", "dropped.no_sensor", 1)["ready"] == "False" and not sketches
    described.publish(sensor_message.encode(sensor))
    graph.reports("sketcher", "ready", True)
    photons.publish(photons_at(STAMP_NS + 1))
    graph.wait(lambda: sketches, "a sketch")


def test_photons_sent_before_the_description_in_force_are_dropped_and_counted(graph, sensor, photons_at):
    """The same array with wider bins: read with the new description, the plane would be at another range."""
    new, descriptions = sensor.replace(num_bins=128, bin_width_s=2 * sensor.bin_width_s), graph.latched("sensor")
    photons, sketches = graph.publisher(PointCloud2, "photons"), graph.collect(PointCloud2, "sketch")

    def describe(described: SensorModel, wait: bool = True) -> None:
        descriptions.publish(sensor_message.encode(described))
        if wait:
            graph.reports("sketcher", "num_bins", described.num_bins)

    node = graph.start("sketcher", frequencies="1,3").ready()
    graph.matched(photons)
    for attempt in range(1, ATTEMPTS + 1):      # the node may read all before the description arrives
        describe(sensor)
        node.pause()
        for _ in range(3):
            photons.publish(photons_at(STAMP_NS))
        describe(new, wait=False)
        node.resume()
        graph.reports("sketcher", "num_bins", new.num_bins)
        graph.reports("sketcher", "messages_in", 3 * attempt)
        report = graph.reports("sketcher", "under_way", 0)
        if "dropped.outdated" in report:
            break
    assert "dropped.outdated" in report, report
    graph.wait(lambda: len(sketches) == int(report["frames_out"]), "the sketches of frames that were read before")
    names = f"sensor_{sensor_message.digest(sensor)}"
    assert all(message.fields[-1].name == names for message in sketches)
    photons.publish(photons_at(STAMP_NS))
    graph.wait(lambda: len(sketches) == int(report["frames_out"]) + 1, "the sketch of a frame sent after it")
    assert sketches[-1].fields[-1].name == f"sensor_{sensor_message.digest(new)}"
