"""Reconstructors of tiles: what two of them in two namespaces publish together, and what one shows of its own."""

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from tests.core.scenes import make_sensor, ramp, simulate
from tests.nodes.conftest import Graph

ROWS, COLS = 150, 162       # so that the window of no tile of 1 × 2 is the whole array


def test_reconstructors_in_two_namespaces_publish_the_cloud_of_one_and_a_tile_changes_live(graph):
    sensor = make_sensor(ROWS, COLS, frame_id="spad")
    depth = ramp(ROWS, COLS, 150, 0.1, 0.2)
    depth[40:100, 30:110] += 90         # a wall with a step off the seam
    sketch = sketch_photons(simulate(depth, 2.0, 10.0, sensor), sensor, choose("auto", sensor, 5))
    message, sketches = sketch_message.encode_cdr(sketch, "spad"), graph.publisher(PointCloud2, "sketch")
    graph.latched("sketch/sensor").publish(sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    inputs = [part for topic in ("sketch", "sketch/sensor") for part in ("-r", f"{topic}:={graph.namespace}/{topic}")]
    right = Graph()         # as of another machine
    try:
        clouds = [graph.collect(PointCloud2, "points"), right.collect(PointCloud2, "points_right")]
        common = {"lossless": True, "fields": "full", "device": "cpu"}
        left = graph.start("reconstructor", tile="0,0,151,1", **common)
        right.start("reconstructor", *inputs, "-r", "__node:=right", "-r", "points:=points_right", tile=[0, 1, 1, 2],
                    **common).ready()
        left.ready()
        impossible = "tile is 0,0,151,1: expected no more tiles than pixels, 150 × 162"
        graph.wait(lambda: impossible in graph.report("reconstructor").get("message", ""), impossible)
        assert graph.set("reconstructor", tile="0,0,1,2") == ""
        graph.reports("reconstructor", "rows", ROWS)
        right.reports("right", "rows", ROWS)
        graph.matched(sketches, 2).publish(message)
        graph.wait(lambda: all(clouds), "a cloud of each tile")
    finally:
        right.close()
    found = [points_message.decode_cdr(serialize_message(received[0])) for received in clouds]
    assert {(header.stamp_ns, header.frame_id) for header, _ in found} == {(sketch.stamp_ns, "spad")}
    assert [set(points["col"] // (COLS // 2)) for _, points in found] == [{0}, {1}]
    together = {name: np.concatenate([points[name] for _, points in found]) for name in found[0][1]}
    order = np.lexsort((together["col"], together["row"]))
    whole = Pooled(sensor, sketch.frequencies, device="cpu")(sketch)
    for name, expected in (("row", whole.row), ("col", whole.col)):
        np.testing.assert_array_equal(together[name][order], expected)
    np.testing.assert_allclose(together["xyz"][order], whole.xyz, atol=0.01 * sensor.bin_width_m)
    np.testing.assert_allclose(together["background"][order], whole.background[whole.row, whole.col], atol=0.1)

    depths, cameras = graph.collect(Image, "depth"), graph.collect(CameraInfo, "camera_info")
    assert graph.set("reconstructor", tile="1,2,2,3", organised=True, upsampling=2) == ""
    sketches.publish(message)
    graph.wait(lambda: len(clouds[0]) == 2 and depths and cameras, "a cloud, a depth image and its camera")
    points, depth_m = (decode(serialize_message(kept[-1]))[1] for decode, kept in (
        (points_message.decode_cdr, clouds[0]), (image_message.decode_cdr, depths)))
    row, col = points["row"] - 2 * 75, points["col"] - 2 * 108
    assert (clouds[0][-1].height, clouds[0][-1].width) == depth_m.shape == (150, 108)
    assert (cameras[-1].height, cameras[-1].width) == depth_m.shape and len(row) > 0.95 * depth_m.size
    np.testing.assert_array_equal(depth_m[row, col], points["xyz"][:, 2])
    fx, cx, cy = (cameras[-1].k[place] for place in (0, 2, 5))
    np.testing.assert_allclose(points["xyz"][:, 0] / points["xyz"][:, 2], (col - cx) / fx, atol=1e-5)
    np.testing.assert_allclose(points["xyz"][:, 1] / points["xyz"][:, 2], (row - cy) / fx, atol=1e-5)
    assert "tile 1,2,2,3: rows 150 to 299, columns 216 to 323" in left.text
    for values, reason in (({"tile": "0,0,2,163"}, "tile is 0,0,2,163: expected no more tiles than pixels, 150 × 162"),
                           ({"tile": "0,3,2,3"}, "tile is 0,3,2,3: expected empty for all, or row,col,rows,cols"),
                           ({"method": "srt3d", "upsampling": 1}, "tile is 1,2,2,3: expected empty, as srt3d")):
        assert graph.set("reconstructor", **values).startswith(reason)
