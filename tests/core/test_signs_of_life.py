"""Pixels without photons claim nothing unless something says that they work."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros import FreeSpaceStream
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.signs_of_life import SignsOfLife
from srt3d_ros.core.sketching.sums import noise_sketch
from tests.core.scenes import make_sensor

SIDE, STEP_NS = 48, 100_000_000
ALL = np.ones((SIDE, SIDE), bool)
BLOCK, COLUMNS = np.zeros((2, SIDE, SIDE), bool)
BLOCK[16:24, 30:38] = COLUMNS[:, 20:23] = True


def known(b: float, frames: int, change, step_ns: int = STEP_NS) -> list[np.ndarray]:
    """Which pixels work, after each frame; `change(k, mean)` gives its expected photons and where it has points."""
    rng, life, out = np.random.default_rng(1), SignsOfLife(ALL), []
    for k in range(frames):
        mean, has_point = change(k, np.full((SIDE, SIDE), b))
        out.append(life((k + 1) * step_ns, rng.poisson(mean), has_point, -1))
    return out


def dying(where: np.ndarray, at: int = 40):
    return lambda k, mean: (mean * ~(where & (k >= at)), ALL & False)


@pytest.mark.parametrize(("b", "alive"), [(0.01, 0.0), (0.1, 0.94), (1.0, 0.999), (10.0, 1.0)])
def test_dark_pixels_work_and_those_dead_from_the_start_do_not(b, alive):
    last = known(b, 60, dying(BLOCK, 0))[-1]
    assert not last[BLOCK].any() and last[:, :26].mean() >= alive and last[:, :26].mean() <= alive + 0.06


@pytest.mark.parametrize(("where", "b", "frames"), [
    (BLOCK, 10.0, 0), (BLOCK, 1.0, 1), (BLOCK, 0.1, 12), (COLUMNS, 10.0, 0), (COLUMNS, 1.0, 1), (COLUMNS, 0.1, 5),
    (COLUMNS.T, 0.1, 5)])
def test_pixels_that_die_claim_nothing_soon(where, b, frames):
    seen = known(b, 41 + frames, dying(where))
    assert seen[39][where].mean() > 0.8 and not seen[-1][where].any()


def test_what_leaves_leaves_pixels_that_work_and_a_wall_before_dead_pixels_does_not():
    def leaves(k, mean):
        return mean + 30 * (BLOCK & (k < 40)), BLOCK & (k < 40)

    def dies(k, mean):
        return np.where(BLOCK & (k >= 40), 0, mean + 30 * BLOCK), BLOCK & (k < 40)
    assert known(1.0, 41, leaves)[-1][BLOCK].all()
    assert not any(seen[BLOCK].any() for seen in known(1.0, 60, dies)[40:])


def test_a_covered_lens_and_dim_light_claim_nothing_and_light_that_halves_does():
    def covered(k, mean):
        return mean * (0.03 if k >= 40 else 1), ALL & False

    def shaded(k, mean):
        return mean * (0.5 if k >= 40 else 1), ALL & False
    assert not any(seen.any() for seen in known(10.0, 100, covered)[40:])
    assert all(seen.mean() > 0.99 for seen in known(10.0, 100, shaded)[40:])


def test_points_in_a_row_that_dies_hide_it_only_where_they_are():
    """Half of the columns show a wall; of three rows that die, the others claim nothing."""
    wall = np.zeros((SIDE, SIDE), bool)
    wall[:, :24] = True

    def dies(k, mean):
        return (mean + 30 * wall) * ~(COLUMNS.T & (k >= 40)), wall & ~(COLUMNS.T & (k >= 40))
    assert not known(0.1, 50, dies)[-1][COLUMNS.T].any()


def test_frames_may_come_fast_and_stamps_may_leap():
    """At 100 Hz a block dies as fast as at 10 Hz; after a leap, signs are needed anew."""
    fast = known(0.1, 500, dying(BLOCK, 400), STEP_NS // 10)
    assert fast[399].mean() > 0.9 and not fast[-1][BLOCK].any()
    life, photons = SignsOfLife(ALL), np.full((SIDE, SIDE), 1)
    stamps = [*range(101, 110), 200, 201, 150]
    works = [life(stamp * STEP_NS, photons, ALL & False, -1).mean() > 0.5 for stamp in stamps]
    assert works == [False, *[True] * 8, False, True, False]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("back_s", [1, 300, 1_000_000])
def test_a_clock_that_is_set_back_begins_a_new_stream_in_which_pixels_that_die_claim_nothing(back_s):
    rng, life = np.random.default_rng(1), SignsOfLife(ALL)
    for start_ns in (2 * 10**15, 2 * 10**15 - back_s * 10**9):
        seen = [life(start_ns + k * STEP_NS, rng.poisson(1.0, BLOCK.shape) * ~(BLOCK & (k >= 20)), ALL & False, -1)
                for k in range(24)]
        assert seen[19].mean() > 0.99 and not seen[-1][BLOCK].any()


def test_masked_and_dim_columns_are_not_taken_for_dead_ones_and_those_beside_them_work():
    rng, exposure = np.random.default_rng(1), np.ones(BLOCK.shape, np.float32)
    exposure[:, 21], exposure[:, 30] = 0, 0.1
    life, blind = SignsOfLife(exposure), SignsOfLife(ALL)
    for k in range(1, 60):
        photons = rng.poisson(exposure)
        works, taken = (each(k * STEP_NS, photons, ALL & False, -1).mean(axis=0) for each in (life, blind))
    assert works.min() > 0.9 and not taken[[19, 23, 28, 32]].any()


def test_a_laser_that_is_off_claims_nothing():
    sensor = make_sensor(SIDE, SIDE)
    stream, noise = FreeSpaceStream(sensor, (1, 2, 3)), noise_sketch(sensor, (1, 2, 3))
    cloud = Pooled(sensor, (1, 2, 3))(noise).within(max_m=-1)
    stamped = [replace(noise, stamp_ns=k * STEP_NS) for k in range(1, 30)]
    assert not any(np.isfinite(stream(each, cloud, 10.0)).any() for each in stamped)
