"""Windows of moved frames: photons add up where the world stands still, and are forgotten where it moved."""

import numpy as np
import pytest

from srt3d_ros.core.deskew import Deskewer
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_window import CELL, FALSE_ALARM_RATE, MovingWindow
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.projection import AngularScan
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons

T, SIDE, STEP, WALL = 500, 45, 0.01, 300
SENSOR = SensorModel(SIDE, SIDE, T, 1e-10, np.exp(-np.linspace(-2, 2, 9)**2),
                     projection=AngularScan(0.2, -STEP, 0.2, -STEP))
FREQUENCIES = choose("auto", SENSOR)
FRAME = 10**8


def seen(depth: np.ndarray, seed: int, ppp: float = 3.0, share: float = 0.5):
    """The sketch of a frame of a depth map, bins, at an SBR of `share` to 1 − `share`."""
    rng = np.random.default_rng(seed)
    lit, dark = (np.repeat(np.arange(SENSOR.pixels), rng.poisson(ppp * part, SENSOR.pixels))
                 for part in (share, 1 - share))
    pulse = rng.choice(9, len(lit), p=SENSOR.irf.astype(float) / SENSOR.irf.sum(dtype=float)) - SENSOR.irf_ref
    toa = np.concatenate([np.rint(depth.ravel()[lit]) + pulse, rng.integers(0, T, len(dark))]) % T
    events = PhotonEvents(np.concatenate([lit, dark]).astype(np.uint32), toa.astype(np.uint16), seed * FRAME)
    return sketch_photons(events, SENSOR, FREQUENCIES)


def trajectory(turn: float = 0.0, frames: int = 12) -> Trajectory:
    """Turns by so many columns a frame."""
    found = Trajectory()
    for k in range(frames):
        found.add(k * FRAME, Pose.turned([0, 0, turn * STEP * k]))
    return found


def slide(depths, frames: int = 10, turn: float = 0.0, **light):
    """The last window's sketch, and the last frame's."""
    deskewer = Deskewer(SENSOR, FREQUENCIES)
    window, known = MovingWindow(deskewer), trajectory(turn)
    window.frames = frames
    for k, depth in enumerate(depths):
        newest = seen(depth, k, **light)
        sketch = window.add(newest, known, deskewer.filled(None))
    return sketch, newest


def flat(depth: float = WALL) -> np.ndarray:
    return np.full((SIDE, SIDE), float(depth))


@pytest.mark.parametrize(("ppp", "share"), [(1, 0.5), (3, 0.5), (10, 0.9), (10, 0.1)])
def test_a_world_that_stands_still_is_forgotten_no_more_often_than_said(ppp, share):
    sketch, _ = slide([flat()] * 5, ppp=ppp, share=share)
    kept = sketch.photons.sum() / (5 * ppp * SENSOR.pixels)
    assert kept > 1 - 20 * FALSE_ALARM_RATE         # a cell forgets four frames, and some more are near it


def test_slopes_and_edges_are_kept():
    world = WALL + 4.0 * np.arange(SIDE) * np.ones((SIDE, 1))
    world[10:30, 10:30] = 100
    sketch, _ = slide([world] * 5, ppp=3)
    assert sketch.photons.sum() / (5 * 3 * SENSOR.pixels) > 0.98


def test_what_moves_is_one_frame_and_the_rest_is_the_window():
    def world(k: int) -> np.ndarray:
        depth = flat()
        depth[12:27, 3 + 6 * k:18 + 6 * k] = 200
        return depth

    sketch, newest = slide([world(k) for k in range(4)])
    box, uncovered = np.s_[13:26, 33:36], np.s_[13:26, 18:20]
    still = np.s_[32:, :]
    omega = 2 * np.pi * np.array(FREQUENCIES) / T
    assert sketch.photons[still].sum() > 0.98 * 4 * 3 * sketch.photons[still].size
    # no photon of the wall that was there
    assert sketch.photons[box].sum() == pytest.approx(newest.photons[box].sum(), rel=1e-3)
    towards = (sketch.sums[uncovered].sum(axis=(0, 1)) * np.exp(-1j * omega * 200)).real.sum()
    wall = (sketch.sums[uncovered].sum(axis=(0, 1)) * np.exp(-1j * omega * WALL)).real.sum()
    assert towards < 0.3 * wall


def test_what_has_come_to_stay_adds_up_again():
    depth = flat()
    depth[12:27, 12:27] = 200
    sketch, _ = slide([flat(), flat(), depth, depth, depth])
    inside = sketch.photons[14:25, 14:25]
    assert inside.sum() == pytest.approx(3 * 3 * inside.size, rel=0.15)


def test_frames_are_moved_to_the_newest_one():
    world = flat() + 100 * (np.arange(SIDE) // 15 % 2)
    sketch, _ = slide([np.roll(world, k, axis=1) for k in range(3)], turn=1.0)
    expected = np.roll(world, 2, axis=1)
    omega = 2 * np.pi * np.array(FREQUENCIES) / T
    own = np.s_[:, 2:]
    shown = (sketch.sums * np.exp(-1j * np.multiply.outer(expected, omega))).real.sum(axis=-1)[own].sum()
    alone = (slide([world])[0].sums * np.exp(-1j * np.multiply.outer(world, omega))).real.sum(axis=-1)[own].sum()
    assert shown > 2.7 * alone


def test_a_window_of_one_frame_is_the_frame():
    sketch, newest = slide([flat()] * 3, frames=1)
    assert sketch is newest


def test_the_window_slides_and_can_be_reset():
    deskewer = Deskewer(SENSOR, FREQUENCIES)
    window, ranges = MovingWindow(deskewer), deskewer.filled(None)
    window.frames = 3
    totals = []
    for k in range(5):
        sketch = window.add(seen(flat(), k), trajectory(), ranges)
        totals.append(round(sketch.photons.sum() / SENSOR.pixels / 3))
        assert sketch.stamp_ns == k * FRAME
    assert totals == [1, 2, 3, 3, 3]
    window.frames = 2
    assert round(window.add(seen(flat(), 5), trajectory(), ranges).photons.sum() / SENSOR.pixels / 3) == 2
    window.reset()
    assert round(window.add(seen(flat(), 6), trajectory(), ranges).photons.sum() / SENSOR.pixels / 3) == 1


def test_frames_that_the_trajectory_no_longer_knows_are_left_out():
    deskewer, known = Deskewer(SENSOR, FREQUENCIES), Trajectory()
    window = MovingWindow(deskewer)
    window.frames = 5
    for k in (2, 3, 4):
        known.add(k * FRAME, Pose())
    for k in range(5):
        covered = trajectory() if k < 4 else known
        sketch = window.add(seen(flat(), k), covered, deskewer.filled(None))
    assert round(sketch.photons.sum() / SENSOR.pixels / 3) == 3


def test_arrays_that_cells_do_not_divide_keep_their_size():
    assert SIDE % CELL == 0
    sensor = SensorModel(4, 5, T, 1e-10, [1])
    deskewer = Deskewer(sensor, (1, 2))
    window = MovingWindow(deskewer)
    window.frames = 2
    events = PhotonEvents(np.arange(20, dtype=np.uint32), np.full(20, 7, np.uint16))
    for _ in range(2):
        sketch = window.add(sketch_photons(events, sensor, (1, 2)), trajectory(), deskewer.filled(None))
    np.testing.assert_allclose(sketch.photons, 2, rtol=1e-5)
