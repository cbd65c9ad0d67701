"""core/motion/trajectory.py: rigid motions and trajectories."""

import numpy as np
import pytest

from srt3d_ros.core.motion.trajectory import KEPT_NS, Pose, Trajectory
from srt3d_ros.errors import InvalidInput

QUARTER_LEFT = Pose.turned([0, 0, np.pi / 2])


def through(stamped) -> Trajectory:
    """The trajectory of these stamps (ns) and poses."""
    trajectory = Trajectory()
    for stamp_ns, pose in stamped:
        trajectory.add(stamp_ns, pose)
    return trajectory


@pytest.mark.parametrize("vector", [(0, 0, 0), (1e-9, 0, 0), (0.3, -0.2, 1.1), (0, 3.0, 0), (0, 0, np.pi)])
def test_a_rotation_vector_makes_a_rotation_and_comes_back(vector):
    pose = Pose.turned(vector)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(pose.rotation_vector, vector, atol=1e-9)


def test_a_quarter_to_the_left_turns_forward_into_left():
    np.testing.assert_allclose(QUARTER_LEFT(np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-12)
    half = np.sqrt(0.5)
    of_quaternion = Pose.from_quaternion([0, 0, half, half])
    np.testing.assert_allclose(of_quaternion.rotation, QUARTER_LEFT.rotation, atol=1e-12)
    np.testing.assert_array_equal(of_quaternion.translation, 0)


@pytest.mark.parametrize(("quaternion", "position", "named"), [
    ([0, 0, 0, 0], [0, 0, 0], "orientation"), ([0, 0, 0, np.nan], [0, 0, 0], "orientation"),
    ([0, 0, 0, 1], [0, np.inf, 0], "position")])
def test_a_pose_that_is_none_is_refused(quaternion, position, named):
    with pytest.raises(InvalidInput, match=named):
        Pose.from_quaternion(quaternion, position)


def test_between_poses_the_sensor_moves_evenly_and_motion_says_where_a_point_of_then_lies_now():
    trajectory = through([(0, Pose()), (100, Pose(QUARTER_LEFT.rotation, np.array([2.0, 0, 0])))])
    middle = trajectory.at(50)
    np.testing.assert_allclose(middle.translation, [1, 0, 0])
    np.testing.assert_allclose(middle.rotation_vector, [0, 0, np.pi / 4], atol=1e-12)
    # 3 m ahead; the sensor goes 2 m ahead and turns left: the point is 1 m to its right (y is left)
    moved = trajectory.at(100).inverse() @ trajectory.at(0)
    np.testing.assert_allclose(moved(np.array([3.0, 0, 0])), [0, -1, 0], atol=1e-12)


def test_a_trajectory_knows_what_it_covers_and_refuses_the_rest():
    trajectory = Trajectory()
    assert not trajectory.covers(0, 0) and trajectory.newest_ns is None
    with pytest.raises(InvalidInput, match="no pose"):
        trajectory.at(0)
    trajectory.add(10, Pose())
    trajectory.add(20, Pose())
    assert trajectory.covers(10, 20) and not trajectory.covers(9, 20) and not trajectory.covers(10, 21)
    with pytest.raises(InvalidInput, match="10 to 20"):
        trajectory.at(21)
    with pytest.raises(InvalidInput, match="later than"):
        trajectory.add(20, Pose())


def test_a_trajectory_keeps_the_last_seconds_only():
    trajectory = through((k * KEPT_NS // 4, Pose()) for k in range(100))
    assert trajectory.covers(98 * KEPT_NS // 4 - KEPT_NS // 2, 99 * KEPT_NS // 4) and not trajectory.covers(0, 0)


def _turning(t_s: float) -> Pose:
    """An even motion: 1 m/s and 1 rad/s about an axis askew."""
    return Pose(Pose.turned(t_s * np.array([0.2, 0.4, np.sqrt(0.8)])).rotation, t_s * np.array([0.6, 0.8, 0]))


def test_smoothing_leaves_an_even_motion_as_it_is():
    exact = through((k * 10_000_000, _turning(k * 0.01)) for k in range(60))
    for stamp_ns in (0, 3_000_000, 255_000_000, 590_000_000):       # also at the ends
        pose, true = exact.at(stamp_ns), _turning(stamp_ns / 1e9)
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-9)
        np.testing.assert_allclose(pose.rotation, true.rotation, atol=1e-9)


def test_smoothing_averages_noise_of_stamps():
    noise_s = np.random.default_rng(0).uniform(-0.02, 0.02, 300)
    trajectory = through((k * 10_000_000, _turning(k * 0.01 + late_s)) for k, late_s in enumerate(noise_s))
    errors = [np.linalg.norm(trajectory.at(t).translation - _turning(t / 1e9).translation)
              for t in range(500_000_000, 2_500_000_000, 7_000_000)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.4 * noise_s.std()                # at 1 m/s


def test_a_pose_is_read_from_seven_numbers_and_no_other_text():
    pose = Pose.from_text("0.2 0, 0.1 0.5 -0.5 0.5 -0.5")
    np.testing.assert_allclose(pose([[0, 0, 1]]), [[1.2, 0, 0.1]], atol=1e-12)
    assert Pose.from_text(" ").translation.tolist() == [0, 0, 0]
    for text in ("1 2 3", "0 0 0 0 0 0 2", "0 0 inf 0 0 0 1", "a"):
        with pytest.raises(InvalidInput, match=f"extrinsics is {text}: expected x y z in metres"):
            Pose.from_text(text)


def test_few_poses_are_not_smoothed():
    sparse = through((k * 100_000_000, Pose(translation=np.array([float(k**2), 0, 0]))) for k in range(5))
    assert sparse.at(250_000_000).translation[0] == pytest.approx(6.5)


def test_in_a_gap_the_motion_is_even():
    broken = through((k * 10_000_000, Pose(translation=np.array([(k / 100) ** 2, 0, 0])))
                     for k in [*range(30), *range(60, 90)])
    assert broken.at(430_000_000).translation[0] == pytest.approx(0.29**2 + 14 / 31 * (0.6**2 - 0.29**2))
