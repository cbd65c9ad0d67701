"""The reconstructor alone: clouds, images on demand, bad messages, devices."""

import dataclasses

import numpy as np
import pytest
import torch
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import base

STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture
def sketch(sensor, events):
    """The sketch of the plane at bin 50."""
    return sketch_photons(dataclasses.replace(events, stamp_ns=STAMP_NS), sensor, choose("auto", sensor, 10))


@pytest.fixture
def send(graph, sensor, sketch):
    """Sends the description, then, once it has arrived, whatever it is given."""
    graph.node.create_publisher(String, "sketch/sensor", base.LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    publisher = graph.publisher(PointCloud2, "sketch")

    def send(*messages):
        graph.reports("reconstructor", "rows", sensor.rows)
        graph.matched(publisher)
        for message in messages:
            publisher.publish(message)

    return send


def test_a_cloud_keeps_stamp_and_frame_and_lies_on_the_plane(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True, fields="full").ready()
    send(sketch_message.encode_cdr(sketch, "spad"))
    graph.wait(lambda: clouds, "a cloud")
    header, points = points_message.decode(clouds[0])
    assert (header.stamp_ns, header.frame_id) == (STAMP_NS, "spad")
    assert len(points["xyz"]) > 0.9 * sensor.pixels
    ranges = np.linalg.norm(points["xyz"], axis=1)
    assert abs(np.median(ranges) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)
    report = graph.reports("reconstructor", "frames_out", 1)
    assert int(report["photons"]) == sketch.photons.sum() and int(report["points"]) == len(ranges)
    assert report["device"] == ("cuda" if torch.cuda.is_available() else "cpu")


def test_images_are_published_while_somebody_subscribes(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    process = graph.start("reconstructor", lossless=True).ready()
    message = sketch_message.encode_cdr(sketch, "spad")
    send(message)
    graph.wait(lambda: len(clouds) == 1, "a cloud")
    images = {name: graph.collect(Image, name) for name in ("depth", "intensity", "background")}
    cameras = graph.collect(CameraInfo, "camera_info")

    def complete():
        send(message)
        return cameras and all(images.values())

    graph.wait(complete, "all images")
    decoded = {name: image_message.decode(received[0]) for name, received in images.items()}
    assert all(header.stamp_ns == STAMP_NS and header.frame_id == "spad" for header, _ in decoded.values())
    assert {image.shape for _, image in decoded.values()} == {(16, 12)}
    assert abs(np.nanmedian(decoded["depth"][1]) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)
    assert (cameras[0].height, cameras[0].width, cameras[0].header.frame_id) == (16, 12, "spad")
    assert process.running


def test_upsampling_gives_points_and_images_of_finer_pixels(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    depths, cameras = graph.collect(Image, "depth"), graph.collect(CameraInfo, "camera_info")
    graph.start("reconstructor", lossless=True, fields="full", upsampling=3).ready()
    message = sketch_message.encode_cdr(sketch, "spad")

    def complete():
        send(message)
        return clouds and depths and cameras

    graph.wait(complete, "a cloud, a depth image and its camera")
    points, depth_m = points_message.decode(clouds[0])[1], image_message.decode(depths[0])[1]
    finer = sensor.upsampled(3)
    assert (points["row"].max(), points["col"].max()) == (finer.rows - 1, finer.cols - 1)
    directions = points["xyz"] / np.linalg.norm(points["xyz"], axis=1, keepdims=True)
    np.testing.assert_allclose(directions, finer.rays[points["row"], points["col"]], atol=1e-5)
    assert depth_m.shape == (finer.rows, finer.cols)
    assert (cameras[0].height, cameras[0].width) == depth_m.shape
    assert (cameras[0].k[0], cameras[0].k[2]) == (finer.projection.fx, finer.projection.cx)


def test_bad_sketches_are_counted_and_survived(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    process = graph.start("reconstructor", lossless=True).ready()
    good = sketch_message.encode_cdr(sketch, "spad")
    small = dataclasses.replace(sketch, sums=sketch.sums[:8], photons=sketch.photons[:8])
    send(good[:200], sketch_message.encode_cdr(small, "spad"), good)
    graph.wait(lambda: clouds, "the cloud of the good sketch")
    report = graph.reports("reconstructor", "frames_out", 1)
    assert (report["frames_in"], report["dropped.malformed"], report["dropped"]) == ("3", "2", "2")
    assert "Traceback" not in process.text


def test_throughput_publishes_every_frame_once_in_the_order_in_which_they_came(graph, sensor, sketch, send):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True, pipeline="throughput", warm_start=True, fields="full").ready()
    frames = [dataclasses.replace(sketch, stamp_ns=STAMP_NS + i) for i in range(12)]
    bad = sketch_message.encode_cdr(sketch, "spad")[:200]
    messages = [sketch_message.encode_cdr(frame, "spad") for frame in frames]
    send(*messages[:5], bad, *messages[5:])
    graph.wait(lambda: len(clouds) == len(frames), "all clouds")
    decoded = [points_message.decode(cloud) for cloud in clouds]
    assert [header.stamp_ns for header, _ in decoded] == [frame.stamp_ns for frame in frames]
    assert all(len(points["xyz"]) > 0.9 * sensor.pixels for _, points in decoded)
    report = graph.reports("reconstructor", "frames_out", len(frames))
    assert (report["frames_in"], report["dropped.malformed"], report["dropped"]) == ("13", "1", "1")


@pytest.mark.parametrize("parameters", [{"method": "smle"}, {"method": "srt3d-paper", "weighting": "precision"}])
def test_other_methods_on_sketches_can_be_chosen(graph, sensor, sketch, send, parameters):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True, **parameters).ready()
    send(sketch_message.encode_cdr(sketch, "spad"))
    graph.wait(lambda: clouds, "a cloud")
    ranges = np.linalg.norm(points_message.decode(clouds[0])[1]["xyz"], axis=1)
    assert len(ranges) > 0.8 * sensor.pixels
    assert abs(np.median(ranges) - sensor.range_m(50)) < sensor.range_m(1) - sensor.range_m(0)


@pytest.mark.parametrize("name, value", [("method", "rt3d"), ("weighting", "half"), ("upsampling", 5),
                                        ("pipeline", "fast")])
def test_what_a_sketch_is_not_enough_for_is_one_line_and_exit_code_2(graph, name, value):
    process = graph.start("reconstructor", **{name: value})
    assert process.code() == 2
    assert len(process.lines) == 1 and process.text.startswith(f"{name} is {value}: expected ")


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_cuda_where_there_is_none_is_one_line_and_exit_code_2(graph):
    process = graph.start("reconstructor", device="cuda")
    assert process.code() == 2
    assert len(process.lines) == 1 and process.text.startswith("device is cuda: expected ")
