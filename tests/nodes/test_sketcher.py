"""The sketcher alone: what it publishes, what it survives, what it follows, what it refuses."""

import dataclasses

import numpy as np
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sketch as sketch_message

STAMP_NS = 1_700_000_000_123_456_789


def photons_at(events, sensor, stamp_ns: int) -> bytes:
    return photons_message.encode_cdr(dataclasses.replace(events, stamp_ns=stamp_ns), sensor, "spad")


def test_a_sketch_is_the_cores_and_keeps_stamp_and_frame_for_events_and_gates(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", layout="float32").ready()
    _, frequencies, window_frames = graph.introduce(sensor)
    assert (frequencies, window_frames) == (choose("auto", sensor, 10), 1)

    graph.matched(photons := graph.publisher(PointCloud2, "photons")).publish(photons_at(events, sensor, STAMP_NS))
    graph.wait(lambda: len(sketches) == 1, "the sketch of the events")
    cycles = PhotonGates.from_events(dataclasses.replace(events, stamp_ns=STAMP_NS + 1), sensor)
    graph.matched(gates := graph.publisher(Image, "gates")).publish(gates_message.encode_cdr(cycles, sensor, "spad"))
    graph.wait(lambda: len(sketches) == 2, "the sketch of the gates")

    expected = sketch_photons(events, sensor, frequencies)
    for k, message in enumerate(sketches):
        header, sketch = sketch_message.decode(message, frequencies, sensor)
        assert (header.stamp_ns, header.frame_id) == (STAMP_NS + k, "spad")
        np.testing.assert_array_equal(sketch.photons, expected.photons)
        np.testing.assert_allclose(sketch.sums, expected.sums, atol=1e-3)
    assert photons.get_subscription_count() == gates.get_subscription_count() == 1


def test_bad_messages_are_counted_said_once_and_survived(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    process = graph.start("sketcher", lossless=True).ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    good = photons_at(events, sensor, STAMP_NS)
    photons.publish(good)
    graph.wait(lambda: len(sketches) == 1, "the first sketch")
    strangers = PhotonEvents(np.array([7], np.uint32), np.array([700], np.uint16))
    foreign = photons_at(strangers, sensor.replace(num_bins=1000), STAMP_NS)
    for bad in (good[:100], good[:-1000], b"\0\1\0\0nonsense", foreign):
        photons.publish(bad)
    graph.reports("sketcher", "dropped.malformed", 4)
    photons.publish(good)
    graph.wait(lambda: len(sketches) == 2, "a sketch after the bad messages")

    report = graph.reports("sketcher", "frames_out", 2)
    assert int(report["frames_in"]) == int(report["frames_out"]) + int(report["dropped"]) == 6
    assert report["last_error"] == "toa is 700: expected bins in [0, 100)"
    assert "frame dropped: " in process.text and "Traceback" not in process.text


def test_a_driver_that_restarts_with_another_sensor_is_followed(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", sketch_size=3).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    photons.publish(photons_at(events, sensor, STAMP_NS))
    graph.reports("sketcher", "dropped.no_sensor", 1)

    wide = sensor.replace(rows=4, cols=5, num_bins=64)
    few = PhotonEvents(np.array([19], np.uint32), np.array([63], np.uint16))
    for number, (model, frame) in enumerate([(sensor, events), (wide, few)], start=1):
        _, frequencies, _ = graph.introduce(model)
        photons.publish(photons_at(frame, model, STAMP_NS))
        graph.wait(lambda: len(sketches) == number, "a sketch of the sensor")
    assert [(message.height, message.width) for message in sketches] == [(16, 12), (4, 5)]
    assert sketch_message.decode(sketches[-1], frequencies, wide)[1].photons[3, 4] == 1
    assert graph.report("sketcher")["errors"] == "0"


def test_packets_make_frames_and_frames_make_windows(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", packets_per_frame=2, window_frames=3, lossless=True, frequencies="1,3").ready()
    _, frequencies, window_frames = graph.introduce(sensor)
    assert (frequencies, window_frames) == ((1, 3), 3)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    for k in range(8):
        photons.publish(photons_at(events, sensor, STAMP_NS + k))
    graph.wait(lambda: len(sketches) == 4, "4 frames of 8 packets")
    decoded = [sketch_message.decode(message, frequencies, sensor) for message in sketches]
    assert [header.stamp_ns - STAMP_NS for header, _ in decoded] == [0, 0, 0, 2]     # of the window's first photons
    assert [int(sketch.photons[0, 0]) for _, sketch in decoded] == [80, 160, 240, 240]


def test_lossless_keeps_photons_that_come_before_their_sensor(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", lossless=True).ready()
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    for k in range(20):
        photons.publish(photons_at(events, sensor, STAMP_NS + k))
    graph.reports("sketcher", "frames_in", 20)
    assert graph.report("sketcher")["message"] == "waiting for a sensor description on sensor"
    graph.introduce(sensor)
    graph.wait(lambda: len(sketches) == 20, "all 20 sketches")
    assert graph.reports("sketcher", "frames_out", 20)["dropped"] == "0"


def test_every_message_of_a_burst_is_accounted_for(graph, sensor, events):
    graph.start("sketcher").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    message = photons_at(events, sensor, STAMP_NS)
    photons.publish(message)
    graph.reports("sketcher", "frames_out", 1)      # misses are counted from the first message that came
    for _ in range(199):
        photons.publish(message)

    def balanced():
        report = {key: int(graph.report("sketcher").get(key, 0)) for key in (
            "frames_in", "frames_out", "dropped", "dropped.queue", "message_lost")}
        assert report["dropped"] == report["dropped.queue"]
        return (report["frames_in"] + report["message_lost"] == 200
                and report["frames_in"] == report["frames_out"] + report["dropped"])

    graph.wait(balanced, "books that balance")


def test_a_bad_parameter_ends_the_start_with_one_line(graph):
    process = graph.start("sketcher", frequencies="banana")
    assert process.code() == 2
    assert len(process.lines) == 1 and process.text.startswith("frequencies is banana: expected auto")


def test_live_parameters_change_and_the_others_refuse_with_a_reason(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    qos = f"qos_overrides.{graph.namespace}/photons.subscription.reliability:=best_effort"
    process = graph.start("sketcher", "-p", qos, sketch_sise=3).ready()
    graph.introduce(sensor)
    reader, = graph.node.get_subscriptions_info_by_topic("photons")
    assert reader.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert "sketcher has no such parameter, did you mean sketch_size?" in process.text
    client = graph.node.create_client(SetParameters, "sketcher/set_parameters")
    assert client.wait_for_service(60)

    def set_parameter(name, value):
        future = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        graph.wait(future.done, "the answer")
        return future.result().results[0]

    assert set_parameter("frame_id", "mast").successful
    refused = set_parameter("sketch_size", 5)
    assert not refused.successful and "read-only" in refused.reason
    graph.matched(photons := graph.publisher(PointCloud2, "photons")).publish(photons_at(events, sensor, STAMP_NS))
    graph.wait(lambda: sketches, "a sketch")
    assert sketches[0].header.frame_id == "mast" and photons
