"""The histogram of all photons of a frame, and the depths that a scene occupies in it."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching import scene_histogram
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sketching.scene_histogram import histogram, occupied

ROWS, COLS, T = 8, 10, 200
SENSOR = SensorModel(ROWS, COLS, T, 1e-10, [1, 2, 1], gates=GateWords(first_word=3, no_detection=0))


def frame(seed=0, background=4000, scene=(), stamp_ns=0, dtype=np.uint16) -> PhotonEvents:
    """An even background, and (photons, bin) of each part of a scene."""
    rng = np.random.default_rng(seed)
    toa = np.concatenate([rng.integers(0, T, background), *(np.full(n, b) for n, b in scene)])
    return PhotonEvents(rng.integers(0, SENSOR.pixels, len(toa), dtype=np.uint32), toa.astype(dtype), stamp_ns)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_each_photon_is_in_its_bin_whatever_its_form(dtype):
    events = frame(dtype=dtype)
    expected = np.bincount(events.toa.astype(int), minlength=T)
    assert np.array_equal(histogram(events, SENSOR), expected)
    assert np.array_equal(histogram(PhotonGates.from_events(events, SENSOR), SENSOR), expected)


def test_masked_pixels_are_left_out_and_delays_taken_off():
    events = frame(background=0, scene=[(500, 60)])
    row, col = np.divmod(events.pixel, COLS)
    late, mask = np.zeros((ROWS, COLS), np.float32), np.ones((ROWS, COLS), bool)
    late[3], mask[:, 4] = 150, False
    seen = histogram(events, SENSOR.replace(delay_bins=late, mask=mask))
    assert seen[60] == ((row != 3) & (col != 4)).sum() and seen[110] == ((row == 3) & (col != 4)).sum()
    gates = PhotonGates.from_events(events, SENSOR)
    assert np.array_equal(histogram(gates, SENSOR.replace(delay_bins=late, mask=mask)), seen)


def test_of_many_photons_some_are_counted(monkeypatch):
    monkeypatch.setattr(scene_histogram, "MOST", 1000)
    for events in (frame(), PhotonGates.from_events(frame(), SENSOR)):
        seen = histogram(events, SENSOR)
        assert 500 < seen.sum() <= 1100


def test_even_background_alone_occupies_nothing():
    found = [occupied(histogram(frame(seed), SENSOR), 2) for seed in range(100)]
    assert found.count(None) >= 99


@pytest.mark.parametrize(("background", "photons"), [(40_000, 120), (4000, 45), (400, 20), (20, 8), (0, 5)])
def test_few_photons_at_one_depth_are_seen_at_any_background(background, photons):
    for seed in range(10):
        seen = occupied(histogram(frame(seed, background, [(photons, 70), (3 * photons, 90)]), SENSOR), 2)
        assert seen is not None and 68 <= seen[0] <= 70 and 90 <= seen[1] <= 92, (seed, seen)


def test_a_faint_part_that_spreads_is_seen_by_wider_windows_and_does_not_widen_a_sharp_one():
    far = [(20, b) for b in range(110, 140)]
    sharp = occupied(histogram(frame(background=20_000, scene=[(2000, 70)]), SENSOR), 2)
    both = occupied(histogram(frame(background=20_000, scene=[(2000, 70), *far]), SENSOR), 2)
    assert 68 <= sharp[0] and sharp[1] <= 72
    assert 68 <= both[0] and 125 <= both[1] <= 155


def test_fog_counts_as_scene_and_hides_none():
    decay = np.random.default_rng(3).exponential(25, 30_000)
    events = frame(background=20_000, scene=[(1500, 100)])
    toa = np.concatenate([events.toa, (20 + decay[decay < 150]).astype(np.uint16)])
    first, last = occupied(np.bincount(toa, minlength=T), 2)
    assert first <= 21 and last >= 100
