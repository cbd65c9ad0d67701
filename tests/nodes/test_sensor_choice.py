"""Which sensor the sketcher reads photons with: a file's or a driver's, whoever starts first, and whose lens."""

import dataclasses

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.camera import camera_info
from srt3d_ros.nodes.topics import LATCHED


@pytest.fixture
def sensor_file(sensor, tmp_path):
    path = tmp_path / "spad.json"
    path.write_text(sensor_message.encode(sensor).data)
    return path


def driver(graph, sensor):
    """A publisher that has described this sensor."""
    publisher = graph.node.create_publisher(String, "sensor", LATCHED)
    publisher.publish(sensor_message.encode(sensor))
    return publisher


def test_the_sensor_may_come_from_a_file_and_its_lens_from_a_camera_info(graph, sensor, sensor_file):
    described = graph.collect_latched(String, "sketch/sensor")
    published = graph.collect_latched(String, "sensor")
    process = graph.start("sketcher", sensor_file=sensor_file).ready()
    graph.wait(lambda: described and published, "the sensor of the file")
    assert sketch_message.decode_sensor(described[0])[0].same_as(sensor)
    assert sensor_message.decode(published[0]).same_as(sensor) and "x_writer" in published[0].data

    cameras = graph.matched(graph.publisher(CameraInfo, "sensor/camera_info"))
    lens = Pinhole(30.0, 31.0, 5.5, 7.5, PlumbBob(k1=-0.1))
    for stamp_ns in (0, 1, 2):
        cameras.publish(camera_info(sensor.replace(projection=lens), stamp_ns, "spad"))
    graph.wait(lambda: len(described) == 2, "the sensor with the lens")
    wrong = sensor.replace(rows=8, projection=lens)
    for stamp_ns in (3, 4):
        cameras.publish(camera_info(wrong, stamp_ns, "spad"))
    graph.wait(lambda: len(described) == 3, "the sensor without a lens that does not fit")
    graph.reports("sketcher", "camera_info_refused", 1)
    cameras.publish(b"\0\1\0\0\5\0")
    assert graph.reports("sketcher", "camera_info_refused", 2)["last_error"] == (
        "message is 8 bytes: expected a serialised CameraInfo")
    assert "its pixels are 8 × 12: expected 16 × 12" in process.text
    assert [sketch_message.decode_sensor(message)[0].projection for message in described[1:]] == [
        lens, sensor.projection]

    assert process.text.count("sensor/camera_info replaces the projection: fx 30, fy 31, cx 5.5, cy 7.5 pixels") == 1
    assert graph.report("sketcher")["errors"] == "0"


@pytest.mark.parametrize("first", ["driver", "sketcher"])
def test_a_driver_that_contradicts_the_file_is_an_error_whoever_starts_first(graph, sensor, events, sensor_file, first):
    other, sketches = sensor.replace(rows=10, cols=8), graph.collect(PointCloud2, "sketch")
    if first == "driver":
        described = driver(graph, other)
    process = graph.start("sketcher", sensor_file=sensor_file).ready()
    if first == "sketcher":
        graph.reports("sketcher", "rows", 16)
        described = driver(graph, other)
    problem = (f"rows on {graph.namespace}/sensor is 10: expected 16 as in sensor_file spad.json; photons are dropped "
               "until both say the same")
    process.says(problem)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    pixels = dataclasses.replace(events, pixel=events.pixel % other.pixels)
    photons.publish(photons_message.encode_cdr(pixels, other, "spad"))
    reported = len(graph.all_reports("sketcher"))
    report = graph.reports("sketcher", "dropped.contradiction", 1)
    graph.wait(lambda: len(graph.all_reports("sketcher")) > reported + 2, "two more reports")
    assert all((report["level"], report["message"]) == (DiagnosticStatus.ERROR, problem)
               for report in graph.all_reports("sketcher")[-2:])        # as long as it lasts
    assert (report["rows"], report["frames_out"], len(sketches)) == ("16", "0", 0)

    described.publish(sensor_message.encode(sensor))        # the driver is right now
    process.says("sensor_file spad.json is used again")
    photons.publish(photons_message.encode_cdr(events, sensor, "spad"))
    graph.wait(lambda: sketches, "a sketch")
    assert (sketches[0].height, sketches[0].width) == (16, 12) and process.text.count("[ERROR]") == 1


def test_a_contradiction_ends_with_its_publisher_and_the_same_again_is_none(graph, sensor, sensor_file):
    described = driver(graph, sensor)
    process = graph.start("sketcher", sensor_file=sensor_file).ready()
    graph.reports("sketcher", "rows", 16)
    described.publish(sensor_message.encode(sensor.replace(toa_offset_bins=3.5)))
    process.says("toa_offset_bins on")
    assert process.text.count("[ERROR]") == 1 and "is 3.5: expected 0.0 as in sensor_file spad.json" in process.text
    graph.wait(lambda: graph.report("sketcher")["level"] == DiagnosticStatus.ERROR, "the error in the diagnostics")
    graph.node.destroy_publisher(described)
    process.says(f"is used again: nobody else publishes {graph.namespace}/sensor any more")
    graph.wait(lambda: graph.report("sketcher")["level"] != DiagnosticStatus.ERROR, "its end")


def test_a_sensor_and_another_one_are_logged_once_each(graph, sensor):
    process = graph.start("sketcher", frequencies="1,2").ready()
    reconstructor = graph.start("reconstructor").ready()
    described = driver(graph, sensor)
    graph.reports("sketcher", "rows", 16)
    described.publish(sensor_message.encode(sensor))
    described.publish(sensor_message.encode(sensor.replace(rows=4, cols=5, num_bins=64)))
    topic = f"{graph.namespace}/sensor"
    process.says(f"another sensor on {topic}: 4 × 5 pixels, 64 bins of 100 ps; rows was 16, is 4")
    assert process.text.count(f"]: sensor on {topic}: 16 × 12 pixels, 100 bins of 100 ps") == 1
    assert process.text.count("another sensor") == 1
    reconstructor.says("sketches: 4 × 5 pixels, 64 bins of 100 ps, 2 frequencies")
