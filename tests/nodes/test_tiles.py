"""Reconstructors of tiles: what four of them in two namespaces publish together, and what each shows of its own."""

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED
from tests.core.scenes import make_sensor, ramp, simulate
from tests.nodes.conftest import Graph

ROWS, COLS = 150, 162       # so that the window of no tile of 2 × 2 is the whole array


@pytest.fixture(scope="module")
def scene():
    """A sketch of a wall with a step off the seams, and its sensor."""
    sensor = make_sensor(ROWS, COLS, frame_id="spad")
    depth = ramp(ROWS, COLS, 150, 0.1, 0.2)
    depth[40:100, 30:110] += 90
    return sketch_photons(simulate(depth, 2.0, 10.0, sensor), sensor, choose("auto", sensor, 5)), sensor


@pytest.fixture
def describe(graph, scene):
    """Publishes sketch/sensor; returns the publisher of sketches."""
    sketch, sensor = scene
    graph.node.create_publisher(String, "sketch/sensor", LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    return graph.publisher(PointCloud2, "sketch")


@pytest.fixture
def right(graph):
    """A second namespace, as of another machine."""
    other = Graph()
    yield other
    other.close()


def test_four_reconstructors_in_two_namespaces_publish_the_cloud_of_one(graph, right, describe, scene):
    (sketch, sensor), clouds = scene, {}
    inputs = [part for topic in ("sketch", "sketch/sensor") for part in ("-r", f"{topic}:={graph.namespace}/{topic}")]
    for row, name in enumerate(("upper", "lower")):
        for col, side in enumerate((graph, right)):
            clouds[row, col] = side.collect(PointCloud2, f"points_{name}")
            side.start("reconstructor", *inputs, "-r", f"__node:={name}", "-r", f"points:=points_{name}", lossless=True,
                       fields="full", device="cpu", tile=[row, col, 2, 2])
    for side in (graph, right):
        for name, process in zip(("upper", "lower"), side.processes):
            process.ready()
            side.reports(name, "rows", ROWS)
    message = sketch_message.encode_cdr(sketch, "spad")
    graph.matched(describe, 4).publish(message)
    graph.wait(lambda: all(clouds.values()), "a cloud of each tile")
    whole = Pooled(sensor, sketch.frequencies, device="cpu")(sketch)
    found = []
    for (row, col), received in clouds.items():
        header, points = points_message.decode_cdr(serialize_message(received[0]))
        assert (header.stamp_ns, header.frame_id) == (sketch.stamp_ns, "spad")
        for name, tile, pixels in (("row", row, ROWS), ("col", col, COLS)):
            assert (points[name] // (pixels // 2) == tile).all()
        found.append(points)
    together = {name: np.concatenate([points[name] for points in found]) for name in found[0]}
    order = np.lexsort((together["col"], together["row"]))
    for name, expected in (("row", whole.row), ("col", whole.col)):
        np.testing.assert_array_equal(together[name][order], expected)
    np.testing.assert_allclose(together["xyz"][order], whole.xyz, atol=0.01 * sensor.bin_width_m)
    np.testing.assert_allclose(together["background"][order], whole.background[whole.row, whole.col], atol=0.1)


def test_images_and_organised_clouds_show_the_tile_which_can_be_changed_live(graph, describe, scene):
    (sketch, sensor), clouds = scene, graph.collect(PointCloud2, "points")
    depths, cameras = graph.collect(Image, "depth"), graph.collect(CameraInfo, "camera_info")
    process = graph.start("reconstructor", lossless=True, organised=True, fields="full", upsampling=2, device="cpu",
                          tile="0,0,151,1").ready()
    message = sketch_message.encode_cdr(sketch, "spad")

    def set_parameters(**values) -> str:
        given = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParametersAtomically.Request(parameters=given)
        return graph.call(SetParametersAtomically, "reconstructor/set_parameters_atomically", request).result.reason

    def shown(first_row: int, first_col: int) -> None:
        """Check a frame of 75 × 54 pixels that begin here."""
        for kept in (clouds, depths, cameras):
            kept.clear()
        describe.publish(message)
        graph.wait(lambda: clouds and depths and cameras, "a cloud, a depth image and its camera")
        points, depth_m = (decode(serialize_message(kept[-1]))[1] for decode, kept in (
            (points_message.decode_cdr, clouds), (image_message.decode_cdr, depths)))
        row, col = points["row"] - 2 * first_row, points["col"] - 2 * first_col
        assert (clouds[-1].height, clouds[-1].width) == depth_m.shape == (150, 108)
        assert (cameras[-1].height, cameras[-1].width) == depth_m.shape and len(row) > 0.95 * depth_m.size
        np.testing.assert_array_equal(depth_m[row, col], points["xyz"][:, 2])
        fx, cx, cy = (cameras[-1].k[place] for place in (0, 2, 5))
        np.testing.assert_allclose(points["xyz"][:, 0] / points["xyz"][:, 2], (col - cx) / fx, atol=1e-5)
        np.testing.assert_allclose(points["xyz"][:, 1] / points["xyz"][:, 2], (row - cy) / fx, atol=1e-5)
        rays = sensor.upsampled(2).rays[points["row"], points["col"]]
        np.testing.assert_allclose(points["xyz"], rays * np.linalg.norm(points["xyz"], axis=1)[:, None], atol=1e-4)

    impossible = "tile is 0,0,151,1: expected no more tiles than pixels, 150 × 162"
    graph.wait(lambda: impossible in graph.report("reconstructor").get("message", ""), impossible)
    assert set_parameters(tile="1,0,2,3") == ""
    graph.reports("reconstructor", "rows", ROWS)
    graph.matched(describe)
    shown(75, 0)
    assert "tile 1,0,2,3: rows 150 to 299, columns 0 to 107" in process.text
    assert set_parameters(tile="0,0,2,163") == "tile is 0,0,2,163: expected no more tiles than pixels, 150 × 162"
    assert set_parameters(tile="0,3,2,3").startswith("tile is 0,3,2,3: expected empty for all, or row,col,rows,cols")
    refused = set_parameters(tile="0,2,2,3", method="srt3d", upsampling=1)
    assert refused.startswith("tile is 0,2,2,3: expected empty, as srt3d")
    assert set_parameters(tile="0,2,2,3") == ""
    shown(0, 108)
