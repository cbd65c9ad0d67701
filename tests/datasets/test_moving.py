"""datasets/room.py, moving.py and motion_profiles.py: exact depths from any pose, smooth paths, odometry's errors."""

from itertools import islice, pairwise

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import FURNITURE, WALLS, Room
from srt3d_ros.datasets.simulation.simulator import Simulator

SENSOR = moving_sensor(side=31)


def rays_to(points, origin) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors float32 [3, N] to points [N, 3], and the distances."""
    way = np.asarray(points, float) - origin
    distance = np.linalg.norm(way, axis=1)
    return np.ascontiguousarray((way / distance[:, None]).T, dtype=np.float32), distance


def test_walls_are_where_geometry_has_them():
    origin = np.array([0.3, -0.2, 1.9])
    points = [(3.5, 0.1, 2.6), (0.1, 3.0, 2.5), (0.2, -3.0, 2.7), (1.5, 0.9, 0), (-1, 1, 2.8), (0.3, -0.2, 2.8)]
    rays, distance = rays_to(points, origin)
    range_m, reflectivity = Room().cast(origin, rays)
    np.testing.assert_allclose(range_m, distance, rtol=2e-6)
    assert (reflectivity > 0.05).all()


def test_a_static_world_stays_where_it_is_while_the_sensor_moves():
    view = MovingView(Room(), walk, SENSOR)
    for t_s in (0.0, 0.7, 5.3):
        range_m, _ = view.at(t_s)
        points = view.sensor_pose(t_s)((SENSOR.rays * range_m[..., None]).reshape(-1, 3))
        inside = np.abs(points - WALLS.middle) - np.array(WALLS.size) / 2
        assert inside.max() < 1e-5
        other = view.sensor_pose(t_s + 0.05)
        rays, distance = rays_to(points, other.translation)
        again, _ = Room().cast(other.translation, rays)
        assert np.median(np.abs(again - distance)) < 1e-5       # some are hidden now
        assert (again < distance + 1e-3).all()


def test_a_walk_is_smooth_and_keeps_away_from_walls_and_furniture():
    step_s = 0.01
    poses = [walk(t) for t in np.arange(0, 60, step_s)]
    steps = [before.inverse() @ after for before, after in pairwise(poses)]
    velocity = np.array([step.translation for step in steps]) / step_s
    turn = np.array([step.rotation_vector for step in steps]) / step_s
    assert np.linalg.norm(velocity, axis=1).max() < 1.3 and np.degrees(np.linalg.norm(turn, axis=1)).max() < 45
    assert np.abs(np.diff(velocity, axis=0)).max() < 5 * step_s and np.abs(np.diff(turn, axis=0)).max() < 2 * step_s
    for box in FURNITURE:
        to_box = Pose(Pose.turned([0, 0, np.radians(box.yaw_deg)]).rotation, np.array(box.middle)).inverse()
        outside = np.abs(to_box(np.array([pose.translation for pose in poses[::10]]))) - np.array(box.size) / 2
        assert (outside.max(axis=1) > 0.2).all(), box
    assert np.abs([pose.translation[:2] for pose in poses]).max() < 2.5


def test_odometry_is_exact_and_its_velocity_holds_until_the_next_report():
    reports = list(islice(measured(walk, 50.0, start_s=1.0), 20))
    for report, after in pairwise(reports):
        np.testing.assert_array_equal(report.pose.translation, walk(report.at_s).translation)
        step = Pose(Pose.turned(report.rate_rad_s / 50).rotation, report.velocity_m_s / 50)
        np.testing.assert_allclose((report.pose @ step).translation, after.pose.translation, atol=1e-12)
        np.testing.assert_allclose((report.pose @ step).rotation, after.pose.rotation, atol=1e-12)


def test_the_truth_of_a_frame_is_that_of_its_middle():
    view = MovingView(Room(), walk, SENSOR, exposure_s=0.01)
    _, truth = Simulator(view, SENSOR, ppp=3, seed=5, frame_rate_hz=100.0).frame(7)
    np.testing.assert_allclose(SENSOR.range_m(truth[0]), view.at(0.075)[0], rtol=1e-5)
    assert np.array_equal(view.sensor_pose(1.0).rotation, (walk(1.0) @ OPTICAL).rotation)
