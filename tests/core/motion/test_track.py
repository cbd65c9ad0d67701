"""Poses, trajectories, and that of a sensor by reports of its robot: what it follows, and where it begins again."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.motion.track import GAP_NS, MotionReport, SensorMotion
from srt3d_ros.core.motion.trajectory import KEPT_NS, Pose, Trajectory
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import through

MS = 1_000_000
FORWARD = np.array([1.0, 0, 0])


def report(ms: float, x: float) -> MotionReport:
    return MotionReport(round(ms * MS), Pose(translation=x * FORWARD))


def followed(*reports: MotionReport, **options) -> tuple[SensorMotion, list[str]]:
    track = SensorMotion(**options)
    return track, [track.add(one) for one in reports]


def test_the_trajectory_is_that_of_the_sensor():
    extrinsics = Pose(Pose.turned([0, 0, np.pi / 2]).rotation, np.array([0.5, 0, 0.2]))
    track, breaks = followed(report(0, 0), report(100, 0.1), extrinsics=extrinsics)
    assert breaks == ["", ""]
    np.testing.assert_allclose(track.trajectory.at(50 * MS).translation, [0.55, 0, 0.2])
    # what lies 1 m to the sensor's right is ahead of the robot, which has come 0.1 m nearer
    moved = track.trajectory.at(100 * MS).inverse() @ track.trajectory.at(0)
    np.testing.assert_allclose(moved(np.array([0, -1.0, 0])), [0, -0.9, 0], atol=1e-12)


def test_an_imus_rate_turns_with_the_sensor_and_changes_evenly_between_reports():
    tilted = Pose(Pose.turned([0, np.pi / 2, 0]).rotation)
    track, _ = followed(*(MotionReport(ms * MS, rate_rad_s=np.array([0, 0, 0.5])) for ms in (0, 100, 200)),
                        extrinsics=tilted)
    turned = tilted.inverse() @ Pose.turned([0, 0, 0.1]) @ tilted
    np.testing.assert_allclose(track.trajectory.at(200 * MS).rotation, turned.rotation, atol=1e-12)
    np.testing.assert_array_equal(track.trajectory.at(200 * MS).translation, 0)
    track, _ = followed(*(MotionReport(ms * MS, rate_rad_s=np.array([0, 0, ms / 100])) for ms in (0, 20, 40, 60)))
    np.testing.assert_allclose(track.trajectory.at(60 * MS).rotation_vector, [0, 0, 0.6 * 0.06 / 2], atol=1e-12)


@pytest.mark.parametrize("stamps_ms", [(0, 20, 20), (0, 20, 10), (1000, 600)])
def test_stamps_that_are_not_later_are_refused_and_the_trajectory_goes_on(stamps_ms):
    *good, bad = stamps_ms
    track, _ = followed(*(report(ms, ms / 1e3) for ms in good))
    with pytest.raises(InvalidInput, match="stamp is .* later than the last"):
        track.add(report(bad, 0))
    assert track.add(report(max(stamps_ms) + 20, max(stamps_ms) / 1e3 + 0.02)) == ""
    assert track.trajectory.covers(stamps_ms[0] * MS, max(stamps_ms) * MS)


@pytest.mark.parametrize("then, why", [
    (replace(report(20, 0.02), frame_id="map"), "frame_id changed from '' to 'map'"),
    (report(-60_000, 0), "fell back by 60.000 s"),
    (report(GAP_NS / MS + 1, 0.5), "no report for 0.501 s"),
])
def test_after_a_leap_a_gap_or_in_another_frame_it_begins_again(then, why):
    track, (*_, said) = followed(report(-20, -0.02), report(0, 0), then)
    assert why in said
    assert track.trajectory.covers(then.stamp_ns, then.stamp_ns) and not track.trajectory.covers(0, 0)
    np.testing.assert_array_equal(track.trajectory.at(then.stamp_ns).translation, then.pose.translation)


QUARTER_LEFT = Pose.turned([0, 0, np.pi / 2])


@pytest.mark.parametrize("vector", [(0, 0, 0), (1e-9, 0, 0), (0.3, -0.2, 1.1), (0, 3.0, 0), (0, 0, np.pi)])
def test_a_rotation_vector_makes_a_rotation_and_comes_back(vector):
    pose = Pose.turned(vector)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(pose.rotation_vector, vector, atol=1e-9)


def test_between_poses_the_sensor_moves_evenly_and_motion_says_where_a_point_of_then_lies_now():
    trajectory = through([(0, Pose()), (100, Pose(QUARTER_LEFT.rotation, np.array([2.0, 0, 0])))])
    middle = trajectory.at(50)
    np.testing.assert_allclose(middle.translation, [1, 0, 0])
    np.testing.assert_allclose(middle.rotation_vector, [0, 0, np.pi / 4], atol=1e-12)
    # 3 m ahead; the sensor goes 2 m ahead and turns left: the point is 1 m to its right (y is left)
    moved = trajectory.at(100).inverse() @ trajectory.at(0)
    np.testing.assert_allclose(moved(np.array([3.0, 0, 0])), [0, -1, 0], atol=1e-12)


def test_a_trajectory_knows_what_it_covers_refuses_the_rest_and_keeps_the_last_seconds():
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
    trajectory = through((k * KEPT_NS // 4, Pose()) for k in range(100))
    assert trajectory.covers(98 * KEPT_NS // 4 - KEPT_NS // 2, 99 * KEPT_NS // 4) and not trajectory.covers(0, 0)


def _turning(t_s: float) -> Pose:
    """An even motion: 1 m/s and 1 rad/s about an axis askew."""
    return Pose(Pose.turned(t_s * np.array([0.2, 0.4, np.sqrt(0.8)])).rotation, t_s * np.array([0.6, 0.8, 0]))


def test_smoothing_leaves_even_motions_few_poses_and_gaps_as_they_are():
    exact = through((k * 10_000_000, _turning(k * 0.01)) for k in range(60))
    for stamp_ns in (0, 3_000_000, 255_000_000, 590_000_000):       # also at the ends
        pose, true = exact.at(stamp_ns), _turning(stamp_ns / 1e9)
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-9)
        np.testing.assert_allclose(pose.rotation, true.rotation, atol=1e-9)
    sparse = through((k * 100_000_000, Pose(translation=np.array([float(k**2), 0, 0]))) for k in range(5))
    assert sparse.at(250_000_000).translation[0] == pytest.approx(6.5)
    broken = through((k * 10_000_000, Pose(translation=np.array([(k / 100) ** 2, 0, 0])))
                     for k in [*range(30), *range(60, 90)])
    assert broken.at(430_000_000).translation[0] == pytest.approx(0.29**2 + 14 / 31 * (0.6**2 - 0.29**2))


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
