"""`extrinsics` on /tf_static, if a frame is named and tf2_msgs is installed, which pip does not offer."""

import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.messages import photon_frames


@pytest.fixture
def sketched(graph, sensor, events):
    """Starts a sketcher and waits for its sketch of a frame from `spad`."""
    def sketched(parent: str, code: str = ""):
        sketches = graph.collect(PointCloud2, "sketch")
        node = graph.start("sketcher", code=code, extrinsics="0.2 0 0.1 0.5 -0.5 0.5 -0.5", extrinsics_frame=parent)
        graph.introduce(sensor)
        photons = graph.matched(graph.publisher(PointCloud2, "photons"))
        photons.publish(photon_frames.PHOTONS.encode_cdr(events, sensor, "spad"))
        graph.wait(lambda: sketches, "a sketch")
        return node

    return sketched


def test_without_tf2_msgs_the_log_says_that_the_transform_is_missing_and_sketches_are_made(sketched):
    node = sketched("base_link", code='import sys; sys.modules["tf2_msgs.msg"] = None')
    line = "extrinsics_frame base_link: nothing is published on /tf_static, as tf2_msgs is missing"
    assert node.text.count(line) == 1


def test_the_pose_of_the_sketches_frame_is_on_tf_static_for_late_readers(graph, sketched):
    messages = pytest.importorskip("tf2_msgs.msg")
    parent = f"base_{graph.namespace[1:]}"
    sketched(parent)
    heard = graph.collect_latched(messages.TFMessage, "/tf_static")
    (one,) = graph.wait(lambda: [one for message in heard for one in message.transforms
                                 if one.header.frame_id == parent], f"a transform from {parent}")
    moved, turned = one.transform.translation, one.transform.rotation
    assert one.child_frame_id == "spad" and (moved.x, moved.y, moved.z) == (0.2, 0.0, 0.1)
    assert [turned.x, turned.y, turned.z, turned.w] == pytest.approx([-0.5, 0.5, -0.5, 0.5])
