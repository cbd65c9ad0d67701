"""Pile-up: what a detector records of the first photon of each cycle gives the scene back, where N is known."""

import dataclasses

import numpy as np
import pytest

import srt3d_ros
from srt3d_ros.core.method.pile_up import saturated
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums

SIDE, BINS, CYCLES = 32, 400, 100
IRF = np.exp(-0.5 * (np.arange(-18, 19) / 3.0)**2)
IRF = IRF / IRF.sum()
ROW, COL = np.mgrid[:SIDE, :SIDE]
WALL = 200.3 + 1.2 * COL + 0.4 * ROW


def rates(surfaces: list[tuple[np.ndarray, float]], background: float) -> np.ndarray:
    """Photons per cycle in each bin, [rows, cols, T], of surfaces (depth, photons per cycle) before a background."""
    bins = np.arange(BINS)
    rate = np.full((SIDE, SIDE, BINS), background / BINS)
    for depth, light in surfaces:
        rate += light * np.interp(bins - depth[..., None], np.arange(-18, 19), IRF, 0, 0)
    return rate


def recorded(rate: np.ndarray, cycles: int = CYCLES, seed: int = 0) -> np.ndarray:
    """Counts of the first photon of each cycle, uint16 [rows, cols, T]."""
    first = -np.expm1(-rate) * np.exp(rate - np.cumsum(rate, axis=2))
    chances = np.concatenate([first, np.maximum(1 - first.sum(axis=2, keepdims=True), 0)], axis=2)
    return np.random.default_rng(seed).multinomial(cycles, chances)[..., :-1].astype(np.uint16)


def cloud_of(counts: np.ndarray, surfaces: int = 1, **options) -> srt3d_ros.Cloud:
    photons = srt3d_ros.from_counts(counts, bin_width_s=1e-10, irf=IRF, fov_deg=10, **options)
    return photons.reconstruct(surfaces=surfaces)


def errors(cloud: srt3d_ros.Cloud, depth: np.ndarray, light: float) -> tuple[float, float, float]:
    """Share of the pixels found within 5 bins, bias (bins), and intensity over the truth, of one surface."""
    error = cloud.depth_bins - depth[cloud.row, cloud.col]
    near = np.abs(error) < 5
    return near.sum() / depth.size, error[near].mean(), cloud.intensity[near].mean() / light


@pytest.fixture(scope="module")
def bright() -> np.ndarray:
    """One photon per cycle of a wall, and half a one of the background."""
    return recorded(rates([(WALL, 1.0)], 0.5))


def test_depth_intensity_and_background_come_back(bright):
    raw, cloud = cloud_of(bright), cloud_of(bright, cycles=CYCLES)
    found, bias, intensity = errors(raw, WALL, CYCLES)
    assert found > 0.99 and bias < -0.6 and intensity < 0.6
    found, bias, intensity = errors(cloud, WALL, CYCLES)
    assert found > 0.99 and abs(bias) < 0.08 and abs(intensity - 1) < 0.04
    assert cloud.background.mean() == pytest.approx(0.5 * CYCLES, rel=0.1)
    error = np.abs(cloud.depth_bins - WALL[cloud.row, cloud.col])
    assert 0.6 < (error <= cloud.depth_std_bins).mean() < 0.9
    np.testing.assert_allclose(cloud.xyz, cloud.sensor.xyz(cloud.row, cloud.col, cloud.depth_bins), rtol=1e-6)


def test_few_photons_leave_no_background_where_there_is_none():
    counts = recorded(rates([(WALL, 0.1)], 0))
    cloud = cloud_of(counts, cycles=CYCLES)
    assert cloud.background.mean() < 0.06 * (0.1 * CYCLES)**0.5
    assert cloud.background.mean() + cloud.intensity.mean() == pytest.approx(0.1 * CYCLES, rel=0.05)


def test_each_frame_of_a_stream_is_corrected_and_one_without_cycles_is_as_ever(bright):
    sketch = srt3d_ros.from_counts(bright, bin_width_s=1e-10, irf=IRF, cycles=CYCLES).sketch()
    unknown = dataclasses.replace(sketch, cycles=0)
    stream = Pooled(sketch.sensor, sketch.frequencies)
    for _ in range(3):
        _, bias, intensity = errors(stream(sketch), WALL, CYCLES)
        assert abs(bias) < 0.08 and abs(intensity - 1) < 0.04
    plain = Pooled(sketch.sensor.replace(cycles=None), sketch.frequencies)(unknown)
    again = Pooled(sketch.sensor, sketch.frequencies)(unknown)
    for name in (*POINT_FIELDS, "background"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plain, name), strict=True)


def test_a_nearer_surface_hides_part_of_a_farther_one():
    near, far = WALL - 100, WALL + 60
    counts = recorded(rates([(near, 0.7), (far, 0.5)], 0.2), 2 * CYCLES)
    cloud = cloud_of(counts, 2, cycles=2 * CYCLES)
    for depth, light in ((near, 0.7), (far, 0.5)):
        found, bias, intensity = errors(cloud, depth, 2 * CYCLES * light)
        assert found > 0.98 and abs(bias) < 0.1 and abs(intensity - 1) < 0.06, light


def test_behind_a_gate_cycles_that_were_over_before_it_do_not_count():
    before = np.full((SIDE, SIDE), 60.0)            # such as a window
    counts = recorded(rates([(before, 0.3), (WALL, 0.5)], 0.8), 4 * CYCLES)
    photons = srt3d_ros.from_counts(counts, bin_width_s=1e-10, irf=IRF, fov_deg=10, cycles=4 * CYCLES)
    sketch = photons.sketch(gate=(150, 349))
    np.testing.assert_array_equal(sketch.before, counts[..., :150].sum(axis=2))
    cloud = sketch.reconstruct()
    found, bias, intensity = errors(cloud, WALL - 150, 2 * CYCLES)
    assert found > 0.99 and abs(bias) < 0.08 and abs(intensity - 1) < 0.03
    assert cloud.background.mean() == pytest.approx(0.4 * 4 * CYCLES, rel=0.05)
    gated = photons.gated(150, 349)
    assert gated.sensor.cycles is None and "pile-up is not corrected" in gated.notes[-1]


def test_gain_delays_and_masked_pixels():
    gain = np.where(COL < SIDE // 2, 0.5, 1.0)
    delay = np.where(ROW < SIDE // 2, 0.0, 60.25)
    rate = rates([(WALL + delay, 1.0)], 0.5) * gain[..., None]
    mask = (ROW + COL) % 7 != 0
    cloud = cloud_of(recorded(rate), cycles=CYCLES, gain=gain, delay_bins=delay, mask=mask)
    _, bias, intensity = errors(cloud, WALL, CYCLES)
    assert abs(bias) < 0.08 and abs(intensity - 1) < 0.05
    dim = cloud.col < SIDE // 2
    assert cloud.intensity[dim].mean() == pytest.approx(cloud.intensity[~dim].mean(), rel=0.08)


def test_a_pixel_with_a_photon_in_nearly_every_cycle_is_saturated_and_unsure(bright):
    rate = rates([(WALL, 1.0)], 0.5)
    rate[:8, :8] *= 6
    counts = recorded(rate)
    sketch = srt3d_ros.from_counts(counts, bin_width_s=1e-10, irf=IRF, cycles=CYCLES).sketch()
    crowded = saturated(sketch)
    assert crowded[:8, :8].all() and not crowded[8:].any()
    assert not saturated(dataclasses.replace(sketch, cycles=0)).any()
    std = sketch.reconstruct().image("depth_std_bins")
    assert np.nanmedian(std[:8, :8]) > 3 * np.nanmedian(std[8:])


def test_nothing_seen_and_every_cycle_seen():
    sensor = SensorModel(4, 5, BINS, 1e-10, IRF, cycles=9)
    for n in (0, 9):
        sketch = PhaseSums((1, 2, 5), np.zeros((4, 5, 3), np.complex64), np.full((4, 5), n, np.uint32), cycles=9,
                        sensor=sensor)
        cloud = Pooled(sensor, sketch.frequencies)(sketch)
        assert len(cloud) == 0 and np.isfinite(cloud.background).all()
        assert (cloud.background > 0).all() == (n > 0)


def test_bright_and_dark_tiles_lie_where_they_are_and_errors_are_as_large_as_claimed():
    tiles = np.where((ROW // 6 + COL // 6) % 2, 1.6, 0.4)[..., None]
    for depth, most in ((WALL, 0.03), (WALL - 0.7 * COL + 6 * np.sin(COL / 7), 0.06)):
        cloud = cloud_of(recorded(rates([(depth, 0.6 * tiles)], 0.6), 300), cycles=300)
        error = cloud.depth_bins - depth[cloud.row, cloud.col]
        assert abs(error.mean()) < most
        assert 0.7 < np.sqrt((error**2).mean() / (cloud.depth_std_bins**2).mean()) < 1.2


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.int64, np.float32, np.float64])
def test_counts_of_any_type_are_corrected(bright, dtype):
    cloud, expected = (cloud_of(counts, cycles=CYCLES) for counts in (bright.astype(dtype), bright))
    np.testing.assert_array_equal(cloud.depth_bins, expected.depth_bins)


def test_a_note_says_why_counts_are_not_corrected(bright):
    counts = bright.astype(np.float32)
    counts[0, 0, 0] = -1
    (note,) = (note for note in cloud_of(counts, cycles=CYCLES).notes if "cycles" in note)
    assert note == "cycles not used, pile-up not corrected: some counts are negative, so something was subtracted"
    assert not any("cycles" in note for note in cloud_of(bright, cycles=CYCLES).notes)


def free_running(rate: np.ndarray, cycles: int, dead_bins: float, seed: int = 0) -> np.ndarray:
    """Counts of detectors that are live again `dead_bins` after each photon, uint16 [rows, cols, T]."""
    rng, bins = np.random.default_rng(seed), rate.shape[2]
    light = np.concatenate([np.zeros((rate[..., 0].size, 1)), np.cumsum(rate.reshape(-1, bins), axis=1)], axis=1)
    counts, live, at = np.zeros((len(light), bins), np.uint16), np.zeros(len(light)), np.arange(len(light))
    while len(at):
        cycle, bin_ = np.divmod(live[at], bins)
        low = bin_.astype(int)
        start = light[at, low] + (bin_ - low) * (light[at, low + 1] - light[at, low])
        turns, rest = np.divmod(start + rng.exponential(size=len(at)), light[at, -1])
        low = np.minimum((light[at] <= rest[:, None]).sum(axis=1) - 1, bins - 1)
        part = (rest - light[at, low]) / (light[at, low + 1] - light[at, low])
        time = (cycle + turns) * bins + low + np.minimum(part, 0.999)
        seen = time < cycles * bins
        at, low, time = at[seen], low[seen], time[seen]
        counts[at, low] += 1
        live[at] = time + dead_bins
    return counts.reshape(rate.shape)


@pytest.mark.parametrize(("periods", "light", "background"), [(1.5, 0.3, 0.1), (2.0, 0.7, 0.3), (1.02, 0.7, 0.3),
                                                              (2.995, 0.7, 0.3)])
def test_a_dead_time_longer_than_a_cycle(periods, light, background):
    counts = free_running(rates([(WALL, light)], background), 600, periods * BINS)
    cloud = cloud_of(counts, cycles=600, dead_time_s=periods * BINS * 1e-10)
    found, bias, intensity = errors(cloud, WALL, 600 * light)
    assert found > 0.99 and abs(bias) < 0.05 and abs(intensity - 1) < 0.05
    assert cloud.background.mean() == pytest.approx(600 * background, rel=0.05)
    error = cloud.depth_bins - WALL[cloud.row, cloud.col]
    assert 0.6 < np.sqrt((error**2).mean() / (cloud.depth_std_bins**2).mean()) < 1.3
    blind = cloud_of(counts, cycles=600)
    assert errors(blind, WALL, 600 * light)[2] < 0.8


def test_a_dead_time_with_two_surfaces_and_behind_a_gate():
    near, dead = np.full((SIDE, SIDE), 60.0), {"cycles": 600, "dead_time_s": 2.8 * BINS * 1e-10}
    photons = srt3d_ros.from_counts(free_running(rates([(near, 0.3), (WALL, 0.4)], 0.3), 600, 2.8 * BINS),
                                    bin_width_s=1e-10, irf=IRF, fov_deg=10, **dead)
    cloud = photons.reconstruct(surfaces=2)
    for depth, light in ((near, 0.3), (WALL, 0.4)):
        found, bias, intensity = errors(cloud, depth, 600 * light)
        assert found > 0.98 and abs(bias) < 0.05 and abs(intensity - 1) < 0.05, light
    sketch = photons.sketch(gate=(150, 349))
    assert sketch.sensor.dead_time.period == pytest.approx(BINS) and sketch.sensor.dead_time.periods == 2
    found, bias, intensity = errors(sketch.reconstruct(), WALL - 150, 600 * 0.4)
    assert found > 0.99 and abs(bias) < 0.1 and abs(intensity - 1) < 0.1


def test_a_dead_time_shorter_than_a_cycle_changes_nothing(bright):
    cloud, expected = (cloud_of(bright, cycles=CYCLES, **dead) for dead in ({"dead_time_s": 0.9 * BINS * 1e-10}, {}))
    for name in (*POINT_FIELDS, "background"):
        np.testing.assert_array_equal(getattr(cloud, name), getattr(expected, name), strict=True)


def test_a_note_says_that_photons_contradict_cycles_and_dead_time(bright):
    def note(**options) -> str:
        return " ".join(note for note in cloud_of(bright, **options).notes if "pile-up" in note)
    assert "100.0% of the pixels have more photons than 40 cycles with one photon a cycle allow" in note(cycles=40)
    assert "cycles with dead_time_s 1e-07 allow" in note(cycles=CYCLES, dead_time_s=1e-7)
    assert note(dead_time_s=1e-7) == "dead_time_s not used, pile-up not corrected: give cycles"
    assert note(cycles=CYCLES) == note(cycles=CYCLES, dead_time_s=1e-9) == note() == ""
