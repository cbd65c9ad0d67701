"""The sketcher alone: what it publishes, what it survives, what it follows, what it refuses."""

import dataclasses

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes.topics import LATCHED
from srt3d_ros.processes import DEADLINE_S
from tests.nodes.conftest import check_outdated

STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture
def start(graph, sensor):
    """Starts a sketcher that knows the sensor: (process, list of its sketches, publisher of its photons)."""
    def start(*ros_args, **parameters) -> tuple:
        sketches = graph.collect(PointCloud2, "sketch")
        process = graph.start("sketcher", *ros_args, **parameters).ready()
        graph.introduce(sensor)
        return process, sketches, graph.matched(graph.publisher(PointCloud2, "photons"))

    return start


@pytest.fixture
def photons_at(events, sensor):
    """The message of the events, acquired at a stamp."""
    return lambda stamp_ns: photons_message.encode_cdr(dataclasses.replace(events, stamp_ns=stamp_ns), sensor, "spad")


def test_a_sketch_is_the_cores_and_keeps_stamp_and_frame_for_all_forms(graph, sensor, events, start):
    _, sketches, photons = start(layout="float32")
    for k, topic in enumerate(CODECS):
        raw = photon_frames.encode_cdr(dataclasses.replace(events, stamp_ns=STAMP_NS + k), topic, sensor)
        publisher = photons if topic == "photons" else graph.matched(graph.publisher(Image, topic))
        publisher.publish(raw)
        graph.wait(lambda: len(sketches) == k + 1, f"the sketch of the {topic}")

    frequencies = choose("auto", sensor, 10)
    expected = sketch_photons(events, sensor, frequencies)
    for k, message in enumerate(sketches):
        header, sketch = sketch_message.decode_cdr(serialize_message(message), frequencies, sensor)
        assert (header.stamp_ns, header.frame_id) == (STAMP_NS + k, "spad")
        np.testing.assert_array_equal(sketch.photons, expected.photons)
        np.testing.assert_allclose(sketch.sums, expected.sums, atol=1e-3)


def test_bad_messages_are_counted_logged_once_and_survived(graph, sensor, start, photons_at):
    process, sketches, photons = start(lossless=True)
    good = photons_at(STAMP_NS)
    photons.publish(good)
    graph.wait(lambda: len(sketches) == 1, "the first sketch")
    outside = PhotonEvents(np.array([7], np.uint32), np.array([700], np.uint16))
    foreign = photons_message.encode_cdr(outside, sensor.replace(num_bins=1000), "spad")
    for bad in (good[:100], good[:-1000], b"\0\1\0\0nonsense", foreign):
        photons.publish(bad)
    graph.reports("sketcher", "dropped.malformed", 4)
    photons.publish(good)
    graph.wait(lambda: len(sketches) == 2, "a sketch after the bad messages")

    report = graph.reports("sketcher", "frames_out", 2)
    assert int(report["frames_in"]) == int(report["frames_out"]) + int(report["dropped"]) == 6
    assert report["last_error"] == "toa is 700: expected bins in [0, 100)"
    assert "frame dropped: " in process.text and "Traceback" not in process.text


def test_photons_sent_before_the_description_in_force_are_dropped_and_counted(graph, sensor, photons_at):
    """The same array with wider bins: read with the new description, the plane would be at another range."""
    descriptions = graph.node.create_publisher(String, "sensor", LATCHED)
    photons, sketches = graph.publisher(PointCloud2, "photons"), graph.collect(PointCloud2, "sketch")
    check_outdated(
        graph, "sketcher", "dropped.outdated", frames=photons, made=sketches, old=sensor,
        new=sensor.replace(num_bins=128, bin_width_s=2 * sensor.bin_width_s),
        describe=lambda described: descriptions.publish(sensor_message.encode(described)),
        send=lambda: photons.publish(photons_at(STAMP_NS)))


def test_packets_make_frames_and_frames_make_windows(graph, sensor, start, photons_at):
    _, sketches, photons = start(packets_per_frame=2, window_frames=3, lossless=True, frequencies="1,3")
    for k in range(8):
        photons.publish(photons_at(STAMP_NS + k))
    graph.wait(lambda: len(sketches) == 4, "4 frames of 8 packets")
    decoded = [sketch_message.decode_cdr(serialize_message(message), (1, 3), sensor) for message in sketches]
    assert [header.stamp_ns - STAMP_NS for header, _ in decoded] == [0, 2, 4, 6]     # where its newest frame began
    assert [int(sketch.photons[0, 0]) for _, sketch in decoded] == [80, 160, 240, 240]
    np.testing.assert_array_equal(decoded[2][1].sums, decoded[3][1].sums)            # to the bit: the same photons


def test_a_window_may_be_stamped_with_the_start_of_its_oldest_frame_and_is_as_old_as_its_stamp(graph, start,
                                                                                               photons_at):
    _, sketches, photons = start(window_frames=3, window_stamp="oldest", lossless=True, gap_s=100)
    now_ns = graph.node.get_clock().now().nanoseconds
    for age_s in (70, 60, 50, 40, 30):
        photons.publish(photons_at(now_ns - age_s * 10**9))
    graph.wait(lambda: len(sketches) == 5, "5 sketches")
    ages_s = [round((now_ns - Time.from_msg(sketch.header.stamp).nanoseconds) * 1e-9) for sketch in sketches]
    assert ages_s == [70, 70, 70, 60, 50]
    latency_s = float(graph.reports("sketcher", "frames_out", 5)["latency_p50_ms"]) / 1e3
    assert 70 <= latency_s < 70 + DEADLINE_S


def test_frames_by_stamp_with_every_packet_accounted_for(graph, sensor, events, start, photons_at):
    process, sketches, photons = start(frame_period_s=0.1, silence_s=0.3, lossless=True, frequencies="1,3")

    def send(*stamps_ms):
        for stamp in stamps_ms:
            photons.publish(photons_at(STAMP_NS + stamp * 1_000_000))

    def frames():
        decoded = [sketch_message.decode_cdr(serialize_message(message), (1, 3), sensor) for message in sketches]
        return [((header.stamp_ns - STAMP_NS) // 1_000_000, int(sketch.photons[0, 0]) // 40)
                for header, sketch in decoded]

    send(0, 20, 60, 40, 40, 100, 60, 140)       # out of order, a double, and one that is late
    graph.wait(lambda: len(frames()) == 2, "the second frame, which only silence ends")
    assert frames() == [(0, 4), (100, 2)]
    send(220, -5000, -4980)                     # began again: the open frame ends with what it has
    graph.wait(lambda: len(frames()) == 4, "the first frame after the beginning")
    assert frames()[2:] == [(220, 1), (-5000, 2)] and "stamps leapt over gap_s: new frame" in process.text
    report = graph.reports("sketcher", "frames_out", 4)
    expected = {"frames_in": 11, "packets": 9, "packets_open": 0, "photons": 9 * events.photons, "dropped.late": 1,
                "dropped.duplicate": 1, "dropped": 2, "errors": 0}
    assert {key: int(report[key]) for key in expected} == expected


def test_a_frame_that_never_gets_its_packets_is_counted_and_a_reset_gives_one_up(graph, start, photons_at):
    _, sketches, photons = start(packets_per_frame=3, window_frames=2, lossless=True)

    def send(*stamps_s):
        for stamp in stamps_s:
            photons.publish(photons_at(STAMP_NS + round(stamp * 1e9)))

    send(0, 0.1, 0.2, 0.3, 0.4, 60, 60.1, 60.2)         # the driver began again when 0.3 and 0.4 waited for a third
    graph.wait(lambda: len(sketches) == 2, "two frames")
    send(60.3, 60.4)
    graph.reports("sketcher", "packets_open", 2)
    assert graph.call(Trigger, "sketcher/reset", Trigger.Request()).success
    send(60.5, 60.6, 60.7)
    graph.wait(lambda: len(sketches) == 3, "a frame after the reset")
    assert [int(np.frombuffer(sketch.data, np.uint32, 1)[0]) for sketch in sketches] == [120] * 3      # no old windows
    report = graph.reports("sketcher", "frames_out", 3)
    assert [int(report[key]) for key in ("frames_in", "packets", "packets_open", "dropped.incomplete")] == [13, 9, 0, 4]


def test_lossless_keeps_photons_that_come_before_their_sensor(graph, sensor, photons_at):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", lossless=True).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    for k in range(20):
        photons.publish(photons_at(STAMP_NS + k))
    graph.reports("sketcher", "frames_in", 20)
    assert graph.report("sketcher")["message"] == "waiting for a sensor description on sensor"
    graph.introduce(sensor)
    graph.wait(lambda: len(sketches) == 20, "all 20 sketches")
    assert graph.reports("sketcher", "frames_out", 20)["dropped"] == "0"


def test_parameters_and_qos_from_the_start_and_live_changes_which_the_sensor_may_refuse(graph, start, photons_at,
                                                                                        tmp_path):
    described = graph.collect_latched(String, "sketch/sensor")
    file = tmp_path / "a.yaml"
    file.write_text("sketchr: {ros__parameters: {sketch_size: 7}}")
    qos = f"qos_overrides.{graph.namespace}"
    process, sketches, photons = start(
        "-p", f"{qos}/photons.subscription.reliability:=best_effort",
        "-p", f"{qos}/sketch.publisher.durability:=transient_local", "--params-file", str(file), sketch_sise=3)
    reader, = graph.node.get_subscriptions_info_by_topic("photons")
    writer, = graph.node.get_publishers_info_by_topic("sketch")
    assert reader.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert writer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert "sketcher has no such parameter, did you mean sketch_size?" in process.text
    assert f"{file}: parameters of /sketchr are for no node here: did you mean {graph.namespace}/sk" in process.text

    def set_parameters(**values):
        changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return graph.call(SetParametersAtomically, "sketcher/set_parameters_atomically",
                          SetParametersAtomically.Request(parameters=changes)).result

    graph.known_to("sketcher")          # nothing is sent twice to a best-effort reader that has not found the writer
    photons.publish(photons_at(STAMP_NS))
    graph.wait(lambda: sketches, "a sketch")
    changes = {"frequencies": "1,4,9", "window_frames": 5, "layout": "int16", "frame_id": "mast"}
    assert set_parameters(**changes).successful
    graph.wait(lambda: len(described) == 2, "the new description")
    assert sketch_message.decode_sensor(described[1])[1:] == ((1, 4, 9), 5)
    photons.publish(photons_at(STAMP_NS + 1))
    graph.wait(lambda: len(sketches) == 2, "a sketch of the new kind")
    assert sketches[1].header.frame_id == "mast" and sketches[1].point_step == 4 + 4 * 3

    for values, reason in (({"frequencies": "auto", "sketch_size": 60}, "sketch_size is 60: expected 1 to 49 for T"),
                           ({"frequencies": "1,50"}, "frequencies is 50: expected integers from 1 to 49"),
                           ({"frequencies": "banana"}, "frequencies is banana: expected auto"),
                           ({"packets_per_frame": 0}, "packets_per_frame out of range"),
                           ({"lossless": True}, "read-only")):
        refused = set_parameters(**values)
        assert not refused.successful and reason in refused.reason
    assert graph.report("sketcher")["errors"] == "0" and len(described) == 2


def test_a_description_that_cannot_be_used_is_reported_until_a_better_one_comes(graph, sensor):
    graph.start("sketcher", sketch_size=64).ready()
    described = graph.node.create_publisher(String, "sensor", LATCHED)
    described.publish(sensor_message.encode(sensor))
    waiting = "waiting for a sensor description on sensor that can be used: "
    graph.wait(lambda: graph.report("sketcher").get("message", "").startswith(waiting), "the reason")
    assert graph.report("sketcher")["message"] != waiting
    described.publish(sensor_message.encode(sensor.replace(num_bins=1000)))
    graph.reports("sketcher", "num_bins", 1000)
    graph.wait(lambda: "waiting" not in graph.report("sketcher")["message"], "no more waiting")
