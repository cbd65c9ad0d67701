"""Fixed frames of a robot: where one is in another."""

import numpy as np

from srt3d_ros.core.frame_tree import FrameTree
from srt3d_ros.core.motion import Pose

HALF_TURN = Pose(Pose.turned([0, 0, np.pi]).rotation, np.array([1.0, 0, 0]))


def test_frames_are_found_up_and_down_the_tree_and_the_last_word_counts():
    tree = FrameTree()
    tree.add("base", "mast", Pose(translation=np.array([0, 0, 5.0])))
    tree.add("base", "/mast", Pose(translation=np.array([0, 0, 2.0])))
    tree.add("mast", "spad", HALF_TURN)
    tree.add("base", "imu", Pose(translation=np.array([0.5, 0, 0])))
    here = np.array([1.0, 0, 0])
    np.testing.assert_allclose(tree.pose("spad", "base")(here), [0, 0, 2], atol=1e-12)
    np.testing.assert_allclose(tree.pose("spad", "imu")(here), [-0.5, 0, 2], atol=1e-12)
    np.testing.assert_allclose(tree.pose("base", "spad")(np.array([0, 0, 2.0])), [1, 0, 0], atol=1e-12)
    assert tree.pose("spad", "spad").same_as(Pose())
    assert tree.pose("spad", "map") is None


def test_a_circle_of_frames_ends():
    tree = FrameTree()
    tree.add("a", "b", HALF_TURN)
    tree.add("b", "a", HALF_TURN)
    assert tree.pose("a", "c") is None and tree.pose("b", "a") is not None
