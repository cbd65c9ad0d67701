"""The sketcher alone: what it publishes, follows and refuses; each packet is published, or counted as dropped."""

import dataclasses
import signal

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
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
        return sketch_message.decode_cdr(raw, sensors[sketch_message.description_of(cdr.CloudMessage.read(raw))])

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
                           ({"frequencies": "48,49"}, "frequencies is [48, 49]: expected some that the sensor's IRF"),
                           ({"gate": "50:60"}, "gate is 50-60: expected 15 bins or more, as many as the IRF has"),
                           ({"gate": True}, "gate is True: expected off, or first and last bin such as 100-400"),
                           ({"frame_id": False}, "frame_id is False: expected text"),
                           ({"packets_per_frame": 0}, "packets_per_frame out of range"),
                           ({"sensor_file": "a.json"}, "read-only")):
        assert reason in graph.set("sketcher", **values)
    assert graph.report("sketcher")["errors"] == "0"


def test_hot_pixels_are_left_out_after_a_second_and_a_leak_is_warned_of(graph, sensor, events):
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.collect_latched(String, "sketch/sensor")
    graph.start("sketcher", frequencies="1,3").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    hot = np.concatenate([events.pixel, np.full(1000, 77, np.uint32)])
    leak = np.concatenate([events.toa, np.arange(1000, dtype=np.uint16) % 100])

    def send(pixel: np.ndarray, toa: np.ndarray) -> bool:
        before, frame = len(sketches), PhotonEvents(pixel, toa, STAMP_NS)
        photons.publish(photon_frames.PHOTONS.encode_cdr(frame, sensor, "spad"))
        return graph.wait(lambda: len(sketches) > before, "a sketch") is not None

    graph.wait(lambda: send(hot, leak) and graph.report("sketcher").get("hot_pixels") == "1", "the hot pixel")
    last = graph.wait(lambda: [one for one in map(sensor_message.from_json, [one.data for one in described])
                               if one.mask is not None], "the mask")[-1]
    assert np.flatnonzero(~last.used).tolist() == [77]
    graph.wait(lambda: send(events.pixel, events.toa * (events.toa < 50)) and "photons are in the first bin" in
               graph.report("sketcher")["message"], "the leak")
    assert graph.set("sketcher", mask="off") == ""
    graph.wait(lambda: sensor_message.from_json(described[-1].data).mask is None, "no mask")


def test_a_parameter_that_does_not_suit_the_sensor_is_an_error_until_it_is_corrected(graph, sensor, photons_at):
    """The gate lies outside; the nodes behind it, and a player, wait until the sketcher is ready."""
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    described.publish(sensor_message.encode_cdr(sensor))
    node = graph.start("sketcher", gate="500-600").ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    node.says(problem := "gate is 500-600: expected ")
    graph.wait(lambda: (report := graph.report("sketcher")).get("level") == DiagnosticStatus.ERROR
               and report["message"].startswith(problem) and report["errors"] == "1", "the error, as long as it lasts")
    assert graph.set("sketcher", gate="off") == ""
    graph.reports("sketcher", "ready", True)
    assert graph.report("sketcher")["level"] != DiagnosticStatus.ERROR
    described.publish(String(data="{"))
    graph.wait(lambda: graph.report("sketcher")["level"] == DiagnosticStatus.ERROR, "another error")
    assert graph.set("sketcher", frequencies="consecutive") == ""     # which does not make the description a good one
    graph.known_to("sketcher")
    assert graph.report("sketcher")["ready"] == "False"
    described.publish(sensor_message.encode_cdr(sensor))
    graph.reports("sketcher", "ready", True)
    photons.publish(photons_at(STAMP_NS + 1))
    graph.wait(lambda: sketches, "a sketch")


def test_photons_sent_before_the_description_in_force_are_dropped_and_counted(graph, sensor, photons_at):
    """The same array with wider bins: read with the new description, the plane would be at another range."""
    new, descriptions = sensor.replace(num_bins=128, bin_width_s=2 * sensor.bin_width_s), graph.latched("sensor")
    photons, sketches = graph.publisher(PointCloud2, "photons"), graph.collect(PointCloud2, "sketch")

    def describe(described: SensorModel, wait: bool = True) -> None:
        descriptions.publish(sensor_message.encode_cdr(described))
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


def test_a_driver_that_contradicts_the_file_is_an_error_as_long_as_it_does(graph, sensor, events, photons_at, tmp_path):
    """The file's sensor is published; the driver is there first, is right for a while, wrong again, and goes."""
    published = graph.collect_latched(String, "sensor")
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    topic, other, path = f"{graph.namespace}/sensor", sensor.replace(rows=10, cols=8), tmp_path / "spad.json"
    described.publish(sensor_message.encode_cdr(other))
    path.write_text(sensor_message.to_json(sensor))
    process = graph.start("sketcher", sensor_file=path).ready()
    graph.wait(lambda: any(sensor_message.from_json(one.data).same_as(sensor) and "x_writer" in one.data
                           for one in published), "the sensor of the file")
    problem = (f"rows on {topic} is 10: expected 16 as in sensor_file spad.json; photons are dropped until both "
               "agree")
    process.says(problem)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    pixels = dataclasses.replace(events, pixel=events.pixel % other.pixels)
    photons.publish(photon_frames.PHOTONS.encode_cdr(pixels, other, "spad"))
    graph.reports("sketcher", "dropped.no_sensor", 1)
    assert all((report["level"], report["message"]) == (DiagnosticStatus.ERROR, problem)
               for report in graph.next_reports("sketcher", 2))         # as long as it lasts
    report = graph.report("sketcher")
    assert (report["rows"], report["frames_out"], len(sketches)) == ("16", "0", 0)

    described.publish(sensor_message.encode_cdr(sensor))        # the driver is right now
    process.says(f"sensor_file spad.json is used again: {topic} agrees again")
    photons.publish(photons_at(0))
    graph.wait(lambda: sketches, "a sketch")
    assert (sketches[0].height, sketches[0].width) == (16, 12) and process.text.count("[ERROR]") == 1

    described.publish(sensor_message.encode_cdr(sensor.replace(toa_offset_bins=3.5)))
    graph.wait(lambda: "is 3.5: expected 0.0 as in sensor_file spad.json" in graph.report("sketcher")["message"],
               "another contradiction")
    graph.node.destroy_publisher(described)
    graph.wait(lambda: graph.node.count_publishers("sensor") == 1, "the driver to be gone")
    graph.known_to("sketcher")
    photons.publish(photons_at(0))
    process.says(f"is used again: {topic} has no other publisher any more")
    graph.wait(lambda: graph.report("sketcher")["level"] != DiagnosticStatus.ERROR, "the end of the error")


def test_a_sensor_of_more_than_max_pixels_is_refused_by_sketcher_and_reconstructor(graph, sensor):
    graph.latched("sensor").publish(sensor_message.encode_cdr(sensor.replace(rows=1024, cols=1024)))
    graph.latched("sketch/sensor").publish(sensor_message.encode_cdr(sensor))
    for name, most in (("sketcher", 2**19), ("reconstructor", 100)):
        graph.start(name, **({"max_pixels": most} if most == 100 else {})).says(
            f"exceeds max_pixels of {name}, {most}: set a larger one")


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
    described.publish(sensor_message.encode_cdr(sensor))
    send(50, 100, 20, 200)                                      # one is late
    photons.publish(photons_at(S)[:-1000])                      # fewer bytes than it says
    graph.reports("sketcher", "dropped.malformed", 1)
    send(300)
    graph.wait(lambda: len(sketches) == 4, "the frame that silence ends")
    send(400)                                                   # its frame is open when another sensor is described
    graph.reports("sketcher", "messages_in", 8)
    for text, problem in (('{"rows": 0}', "schema_version is absent: expected 1"),
                          (sensor_message.to_json(sensor.replace(num_bins=20, irf=np.ones(3), irf_ref=1)),
                           "sketch_size is 20: expected 1 to 9 for T = 20 bins")):
        described.publish(String(data=text))
        graph.wait(lambda problem=problem: graph.report("sketcher")["message"].startswith(problem), problem)
        send(500, 501)
        report = graph.next_reports("sketcher", 3)[-1]
        assert (report["level"], report["message"][:len(problem)]) == (DiagnosticStatus.ERROR, problem)
    graph.reports("sketcher", "dropped.no_sensor", 4)
    described.publish(sensor_message.encode_cdr(sensor))
    graph.wait(lambda: graph.report("sketcher")["level"] != DiagnosticStatus.ERROR, "the end of the error")
    send(1_500)
    graph.reports("sketcher", "packets", 6)
    assert node.end(signal.SIGINT) == 0
    last = graph.reports("sketcher", "state", "finalized")
    causes = {"no_sensor": (4, 0), "late": (1, n), "malformed": (1, 0), "incomplete": (1, n)}
    assert {key: (int(last[f"dropped.{key}"]), int(last.get(f"photons_dropped.{key}", 0))) for key in causes} == causes


def test_a_driver_of_best_effort_is_read_whenever_it_comes_and_not_in_spite_of_the_user(graph, sensor, photons_at):
    sketches, described = graph.collect(PointCloud2, "sketch"), graph.latched("sensor")
    described.publish(sensor_message.encode_cdr(sensor))
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
        _, sketch = sketch_message.decode_cdr(raw, sensors[sketch_message.description_of(cdr.CloudMessage.read(raw))])
        mean = sketch.sums[..., 0].sum()                # of frequency 1
        depths.append(np.angle(mean) / (2 * np.pi) * sketch.sensor.num_bins % sketch.sensor.num_bins
                      + sketch.sensor.toa_offset_bins)
    np.testing.assert_allclose(depths, 50, atol=1)
    assert len({sketch.fields[-1].name for sketch in sketches}) == 2
    report = graph.reports("sketcher", "frames_out", 24)
    assert int(report["photons_dropped.gate"]) > 0 and report["dropped"] == "0"
