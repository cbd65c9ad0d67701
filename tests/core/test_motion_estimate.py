"""core/motion_estimate.py: a sensor's motion from its photons and the last cloud's ranges."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.motion_estimate import MotionEstimator, Surfaces
from srt3d_ros.core.moving_sketcher import MovingFrame
from srt3d_ros.core.scan_rate import ScanRate
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.motion_profiles import hand, walk
from srt3d_ros.datasets.moving import MovingView, moving_sensor
from srt3d_ros.datasets.room import Room
from srt3d_ros.datasets.simulator import Simulator

SENSOR = moving_sensor(64)
VIEW = MovingView(Room(), walk, SENSOR)
SHAKEN = MovingView(Room(), lambda t_s: walk(2) @ hand(t_s), SENSOR)
FREQUENCIES = (1, 2, 4, 6, 9, 14, 20, 29, 41, 58)
PARTS, PART_S = 5, 0.02
CLOUD_S = 1.95          # a frame before the photons


class Later:
    """The room, seen on the way from 2 s on."""

    def __init__(self, view):
        self._view = view

    def frame(self, t_s):
        range_m, reflectivity = self._view.at(2.0 + t_s + PART_S / 2)
        return range_m[None], reflectivity[None]


def frames(ppp, sbr=1.0, count=1, view=VIEW):
    """Frames of 100 ms from 2 s on."""
    simulator = Simulator(Later(view), SENSOR, sbr, ppp / PARTS, 1, 1 / PART_S)
    for k in range(count):
        first_ns = round((2.0 + k * PARTS * PART_S) * 1e9)
        parts = [(round((2.0 + (part + 0.5) * PART_S) * 1e9),
                  sketch_photons(simulator.frame(part)[0], SENSOR, FREQUENCIES))
                 for part in range(k * PARTS, (k + 1) * PARTS)]
        yield MovingFrame(parts, first_ns, first_ns + 10**8, first_ns + 5 * 10**7)


def surfaces(t_s, view=VIEW):
    """Of an exact cloud."""
    return Surfaces.of_ranges(round(t_s * 1e9), view.at(t_s)[0], SENSOR)


def wrong_by(trajectory, first_s, last_s, view=VIEW):
    """How far points 2 m ahead are from where they should be after a motion, metres."""
    ahead = 2 * SENSOR.rays[::16, ::16].reshape(-1, 3).astype(float)
    true = view.sensor_pose(last_s).inverse() @ view.sensor_pose(first_s)
    found = trajectory.motion(round(first_s * 1e9), round(last_s * 1e9))
    return float(np.linalg.norm(found(ahead) - true(ahead), axis=1).max()), float(np.linalg.norm(true(ahead) - ahead,
                                                                                               axis=1).max())


def test_photons_show_the_motion_of_the_sensor_from_rest_and_from_frame_to_frame():
    estimator = MotionEstimator(SENSOR, FREQUENCIES)
    for k, frame in enumerate(frames(10, count=3)):
        trajectory = estimator.follow(surfaces(CLOUD_S + 0.1 * k), frame)
    error_m, motion_m = wrong_by(trajectory, CLOUD_S, 2.3)
    assert motion_m > 0.5 and error_m < 0.1 * motion_m
    assert np.abs(estimator.twist[3:]).max() == pytest.approx(1, abs=0.2)       # m/s, as walk says


def test_a_sensor_that_is_shaken_is_followed():
    estimator = MotionEstimator(SENSOR, FREQUENCIES)
    for k, frame in enumerate(frames(10, count=5, view=SHAKEN)):
        trajectory = estimator.follow(surfaces(CLOUD_S + 0.1 * k, SHAKEN), frame)
        assert wrong_by(trajectory, 2 + 0.1 * k, 2.05 + 0.1 * k, SHAKEN)[0] < 0.02


def test_a_scanner_is_followed_by_the_times_of_its_pixels():
    scanner = SENSOR.replace(scan=ScanRate(0, PARTS * PART_S / (SENSOR.cols - 1)))
    estimator = MotionEstimator(scanner, FREQUENCIES)
    looks = np.minimum((scanner.pixel_times_s / PART_S).astype(int), PARTS - 1)
    for k, frame in enumerate(frames(10 * PARTS, count=4)):
        sums = sum(np.where((looks == part)[..., None], sketch.sums, 0) for part, (_, sketch) in enumerate(frame.parts))
        photons = sum(np.where(looks == part, sketch.photons, 0) for part, (_, sketch) in enumerate(frame.parts))
        scanned = replace(frame, parts=[(frame.first_ns, Sketch(FREQUENCIES, sums, photons))])
        trajectory = estimator.follow(surfaces(CLOUD_S + 0.1 * k), scanned)
    error_m, motion_m = wrong_by(trajectory, 2.3, 2.4)
    assert motion_m > 0.15 and error_m < 0.1 * motion_m


def test_within_a_frame_the_sensor_accelerates_as_it_did_before():
    """Shaken at 6 m/s², it would be 17 to 24 mm off if its motion were even."""
    class Told(MotionEstimator):
        def __call__(self, found, parts):
            first_s, last_s = found.stamp_ns / 1e9, found.stamp_ns / 1e9 + 0.15
            motion = SHAKEN.sensor_pose(first_s).inverse() @ SHAKEN.sensor_pose(last_s)
            return np.concatenate([motion.rotation_vector, motion.translation]) / 0.15

    estimator, nothing = Told(SENSOR, FREQUENCIES), np.zeros((0, 3), np.float32)
    for first_s in (2.0, 2.1, 2.2, 2.3, 2.4):
        first_ns, cloud_ns = round(first_s * 1e9), round((first_s - 0.05) * 1e9)
        frame = MovingFrame([], first_ns, first_ns + 10**8, first_ns + 5 * 10**7)
        trajectory = estimator.follow(Surfaces(cloud_ns, nothing, nothing), frame)
        assert wrong_by(trajectory, first_s, first_s + 0.05, SHAKEN)[0] < 0.012


def test_photons_that_fit_no_surface_show_nothing_and_the_next_frame_begins_anew():
    estimator = MotionEstimator(SENSOR, FREQUENCIES)
    dark, = frames(3, sbr=1e-6)
    assert estimator.follow(surfaces(CLOUD_S), dark) is None
    frame, = frames(10)
    assert wrong_by(estimator.follow(surfaces(CLOUD_S), frame), CLOUD_S, 2.1)[0] < 0.03


def test_an_empty_cloud_shows_nothing():
    nothing = Surfaces.of_ranges(0, np.full((64, 64), np.nan, np.float32), SENSOR)
    frame, = frames(3)
    assert MotionEstimator(SENSOR, FREQUENCIES).follow(nothing, frame) is None


def test_surfaces_have_the_normals_of_planes_and_none_at_edges():
    """A wall 2 m ahead on the left, 3 m on the right."""
    depth = np.where(np.arange(64) < 32, 2.0, 3.0)
    found = Surfaces.of_ranges(0, (depth / SENSOR.rays[..., 2]).astype(np.float32), SENSOR)
    np.testing.assert_allclose(np.abs(found.normals[:, 2]), 1, atol=0.02)
    np.testing.assert_allclose(found.points[:, 2], np.where(found.points[:, 0] < 0, 2, 3), rtol=0.01)
