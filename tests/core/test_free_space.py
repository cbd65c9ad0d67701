"""What is claimed to be empty is: objects of the promised brightness, and where nothing can be said, dead pixels."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros import FreeSpaceStream, from_counts
from srt3d_ros.core.free_space import FreeSpace
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.signs_of_life import SignsOfLife
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.sums import noise_sketch
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import background_alone, make_sensor, simulate

SIDE = 64
SENSOR = make_sensor(SIDE, SIDE, num_bins=1000, bin_width_s=1e-10, irf=np.exp(-np.arange(-16, 17)**2 / 32))
FREQUENCIES = choose_frequencies("auto", SENSOR, 10)
FREE = FreeSpace(SENSOR, FREQUENCIES)


def objects(height: int, width: int) -> np.ndarray:
    """Where objects of this size are, 12 pixels apart; bool [rows, cols]."""
    row, col = np.mgrid[:SIDE, :SIDE] - 2
    return (row % (height + 12) < height) & (col % (width + 12) < width) & (row >= 0) & (col >= 0)


def frame_of(at_m: float, where: np.ndarray, r: float, b: float, seed: int, sensor=SENSOR):
    """The sketch of objects with r signal photons a pixel, before open sky with b background photons."""
    depth, signal = np.where(where, sensor.depth_bins(at_m), np.nan), r * where.mean()
    return sketch_photons(simulate(depth, signal / b, signal + b, sensor, seed), sensor, FREQUENCIES)


def sky(b: float, seed: int = 0, sensor=SENSOR):
    return sketch_photons(background_alone(sensor, b, seed), sensor, FREQUENCIES)


@pytest.mark.parametrize(("b", "height", "width"), [(0.1, 3, 3), (0.1, 30, 1), (1, 30, 1), (10, 2, 5)])
def test_objects_at_the_end_of_a_claim_are_behind_at_most_5_percent_of_claiming_pixels(b, height, width):
    """Points behind an object do not count; points near it end the claims."""
    where, method, at_m = objects(height, width), Pooled(SENSOR, FREQUENCIES), 7.0
    empty = sky(b)
    r = 1 / np.nanmedian(FREE.range_m(empty, method(empty), 1.0))**2       # 2 r_min
    claims = np.zeros((2, SIDE, SIDE))
    for seed in range(200 // (where.sum() // (height * width)) + 1):
        for claiming, (times, most) in zip(claims, ((1, 1e6), (2.5, 1))):
            seen = frame_of(at_m, where, times * r, b, seed)
            claiming += FREE.range_m(seen, method(seen), times * r * at_m**2 * most) > at_m + 0.3
    missed = claims[:, where].mean(axis=1) / (seed + 1)
    assert missed[0] <= 0.05 and missed[1] <= 0.001


def test_a_claim_is_as_far_as_an_object_can_be_seen():
    """An object of 3 × 3 pixels is found at 0.6 of the claim or nearer, and beyond 1.6 times it is mostly lost."""
    empty, where = sky(1.0), objects(3, 3)
    claim_m = np.nanmedian(FREE.range_m(empty, pooled_cloud(empty), 60.0))
    assert 4 < claim_m < 8
    found = [np.isfinite(pooled_cloud(frame_of(at_m, where, 60 / at_m**2, 1.0, 5)).range_image())[where].mean()
             for at_m in (0.6 * claim_m, 1.6 * claim_m)]
    assert found[0] > 0.95 and found[1] < 0.5


def pooled_cloud(sketch):
    return Pooled(sketch.sensor, sketch.frequencies)(sketch)


def test_photons_that_come_before_in_a_cycle_shorten_claims():
    """Half the cycles end before an object half way: a claim that forgets it would reach behind the object."""
    sensor = SENSOR.replace(cycles=100)
    empty = replace(sky(60.0), cycles=100, sensor=sensor)
    free, cloud = FreeSpace(sensor, FREQUENCIES), pooled_cloud(empty)
    claim_m = np.nanmedian(free.range_m(empty, cloud, 400.0))
    without_m = np.nanmedian(FREE.range_m(replace(empty, cycles=0, sensor=SENSOR), cloud, 400.0))
    survival = np.exp(np.log1p(-0.6) * SENSOR.depth_bins(claim_m) / SENSOR.num_bins)
    assert claim_m == pytest.approx(without_m * np.sqrt(survival), rel=0.06)
    dead = sensor.replace(dead_time_s=1.2 * SENSOR.num_bins * SENSOR.bin_width_s)
    claim_m = np.nanmedian(FreeSpace(dead, FREQUENCIES).range_m(replace(empty, sensor=dead), cloud, 400.0))
    assert 0.5 < claim_m / (without_m * np.sqrt(0.28)) < 1      # live in 28 of 100 cycles


def test_gain_mask_limits_and_points_near_end_claims():
    gain, mask = np.ones((SIDE, SIDE), np.float32), np.ones((SIDE, SIDE), bool)
    gain[:, 40:], mask[10, 10] = 0.25, False
    sensor, wall = SENSOR.replace(gain=gain, mask=mask), np.zeros((SIDE, SIDE), bool)
    wall[30:, :20] = True
    seen = frame_of(2.0, wall, 30.0, 1.0, 3, sensor)
    cloud = pooled_cloud(seen)
    free = seen_m = FreeSpace(sensor, FREQUENCIES).range_m(seen, cloud, 60.0)
    has_point = np.isfinite(cloud.range_image())
    assert (np.isnan(free) == (has_point | ~mask)).all()
    assert seen_m[40, 20:22].max() < 2.1 < seen_m[40, 25]
    ratio = np.nanmedian(free[:, 45:]) / np.nanmedian(free[:20, :35])
    assert 0.5 < ratio < 0.75           # a quarter of the signal; of the background, too
    assert np.nanmax(FreeSpace(sensor, FREQUENCIES).range_m(seen, cloud, 60.0, max_range_m=3.0)) == 3
    far = FreeSpace(sensor, FREQUENCIES).range_m(seen, cloud, 1e6)
    assert np.nanmax(far) == pytest.approx(float(sensor.range_m(1000)))


def test_an_uneven_background_shortens_claims():
    decay = np.exp(-np.arange(1000) / 80)
    fog, wall, claims = SENSOR.replace(background_shape=0.2 / 1000 + 0.8 * decay / decay.sum()), objects(64, 40), []
    for sensor in (SENSOR, fog):
        method, seen = Pooled(SENSOR, FREQUENCIES), replace(frame_of(9.0, wall, 5.0, 5.0, 1, sensor), sensor=SENSOR)
        clouds = [method(seen) for _ in range(3)]
        claims.append(np.nanmedian(FREE.range_m(seen, clouds[-1], 60.0)))
        assert (clouds[-1].clutter == 1) == (sensor is SENSOR)
    assert claims[1] < 0.9 * claims[0]


@pytest.mark.parametrize("changes", [
    {"toa_offset_bins": 25.0}, {"range_offset_m": 0.4}, {"histograms": HistogramBins(100, 30.0, 9.0)},
    {"histograms": HistogramBins(1000, template=np.zeros(1000))}])
def test_nothing_is_claimed_if_near_space_is_unseen_or_photons_were_subtracted(changes):
    seen = sky(1.0)
    assert np.isfinite(FREE.range_m(seen, pooled_cloud(seen), 60.0)).all()
    assert np.isnan(FreeSpace(SENSOR.replace(**changes), FREQUENCIES).range_m(seen, pooled_cloud(seen), 60.0)).all()


def test_nothing_is_claimed_if_ambient_light_was_subtracted():
    """With as many photons as the counts say, the sums would be less noisy."""
    counts = np.random.default_rng(0).poisson(0.012, (SIDE, SIDE, 1000)).astype(np.float32)
    claims = [seen.free_range_m(seen.reconstruct(device="cpu"), brightness=60.0) for seen in (
        from_counts(each, sensor=SENSOR).sketch(10) for each in (counts, counts - np.float32(0.012)))]
    assert np.isfinite(claims[0]).mean() > 0.99 and np.isnan(claims[1]).all()


def test_what_cannot_be_used_is_refused():
    seen = sky(1.0)
    cloud = pooled_cloud(seen)
    for brightness in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidInput, match="brightness"):
            FREE.range_m(seen, cloud, brightness)
    with pytest.raises(InvalidInput, match="pooled"):
        FREE.range_m(seen, replace(cloud, clutter=None), 60.0)


# ---- Signs of life: pixels without photons claim nothing unless something says that they work

SMALL, STEP_NS = 48, 100_000_000
ALL = np.ones((SMALL, SMALL), bool)
BLOCK, COLUMNS = np.zeros((2, SMALL, SMALL), bool)
BLOCK[16:24, 30:38] = COLUMNS[:, 20:23] = True


def working(b: float, frames: int, change, step_ns: int = STEP_NS) -> list[np.ndarray]:
    """Which pixels work, after each frame; `change(k, mean)` gives its expected photons and where it has points."""
    rng, life, out = np.random.default_rng(1), SignsOfLife(ALL), []
    for k in range(frames):
        mean, has_point = change(k, np.full((SMALL, SMALL), b))
        out.append(life((k + 1) * step_ns, rng.poisson(mean), has_point, -1))
    return out


def dying(where: np.ndarray, at: int = 40):
    return lambda k, mean: (mean * ~(where & (k >= at)), ALL & False)


@pytest.mark.parametrize(("b", "alive"), [(0.01, 0.0), (0.1, 0.94), (1.0, 0.999), (10.0, 1.0)])
def test_dark_pixels_work_and_those_dead_from_the_start_do_not(b, alive):
    last = working(b, 60, dying(BLOCK, 0))[-1]
    assert not last[BLOCK].any() and last[:, :26].mean() >= alive and last[:, :26].mean() <= alive + 0.06


@pytest.mark.parametrize(("where", "b", "frames"), [
    (BLOCK, 10.0, 0), (BLOCK, 1.0, 1), (BLOCK, 0.1, 12), (COLUMNS, 10.0, 0), (COLUMNS, 1.0, 1), (COLUMNS, 0.1, 5),
    (COLUMNS.T, 0.1, 5)])
def test_pixels_that_die_claim_nothing_soon(where, b, frames):
    seen = working(b, 41 + frames, dying(where))
    assert seen[39][where].mean() > 0.8 and not seen[-1][where].any()


def test_what_leaves_leaves_pixels_that_work_and_a_wall_before_dead_pixels_does_not():
    def leaves(k, mean):
        return mean + 30 * (BLOCK & (k < 40)), BLOCK & (k < 40)

    def dies(k, mean):
        return np.where(BLOCK & (k >= 40), 0, mean + 30 * BLOCK), BLOCK & (k < 40)
    assert working(1.0, 41, leaves)[-1][BLOCK].all()
    assert not any(seen[BLOCK].any() for seen in working(1.0, 60, dies)[40:])


def test_a_covered_lens_and_dim_light_claim_nothing_and_light_that_halves_does():
    def covered(k, mean):
        return mean * (0.03 if k >= 40 else 1), ALL & False

    def shaded(k, mean):
        return mean * (0.5 if k >= 40 else 1), ALL & False
    assert not any(seen.any() for seen in working(10.0, 100, covered)[40:])
    assert all(seen.mean() > 0.99 for seen in working(10.0, 100, shaded)[40:])


def test_points_in_a_row_that_dies_hide_it_only_where_they_are():
    """Half of the columns show a wall; of three rows that die, the others claim nothing."""
    wall = np.zeros((SMALL, SMALL), bool)
    wall[:, :24] = True

    def dies(k, mean):
        return (mean + 30 * wall) * ~(COLUMNS.T & (k >= 40)), wall & ~(COLUMNS.T & (k >= 40))
    assert not working(0.1, 50, dies)[-1][COLUMNS.T].any()


def test_frames_may_come_fast_and_stamps_may_leap():
    """At 100 Hz a block dies as fast as at 10 Hz; after a leap, signs are needed anew."""
    fast = working(0.1, 500, dying(BLOCK, 400), STEP_NS // 10)
    assert fast[399].mean() > 0.9 and not fast[-1][BLOCK].any()
    life, photons = SignsOfLife(ALL), np.full((SMALL, SMALL), 1)
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
    sensor = make_sensor(SMALL, SMALL)
    stream, noise = FreeSpaceStream(sensor, (1, 2, 3)), noise_sketch(sensor, (1, 2, 3))
    cloud = Pooled(sensor, (1, 2, 3))(noise).within(max_m=-1)
    stamped = [replace(noise, stamp_ns=k * STEP_NS) for k in range(1, 30)]
    assert not any(np.isfinite(stream(each, cloud, 10.0)).any() for each in stamped)
