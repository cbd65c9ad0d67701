"""Hot pixels, leaks and times in another unit are found, and what looks like them is left alone."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.plausibility import LightWatch, hot_pixels, leak, light_of, other_unit

SENSOR = SensorModel(16, 20, 80, 1e-10, [1, 2, 1], gates=GateWords())
HOT = [(0, 0), (3, 7), (3, 8), (15, 10)]


def cube(extra=()) -> np.ndarray:
    """A wall at bin 50 and background, and photons of `extra` (row, col, bins, photons in each)."""
    counts = np.random.default_rng(0).poisson(0.05, (16, 20, 80)).astype(np.uint16)
    counts[..., 50] += 10
    for row, col, bins, photons in extra:
        counts[row, col, bins] += photons
    return counts


def forms(counts: np.ndarray) -> list:
    histograms = PhotonHistograms(counts)
    gates = np.full((int(counts.sum(axis=2).max()), 16, 20), 65_535, np.uint16)
    for row, col in np.ndindex(16, 20):
        toa = np.arange(80).repeat(counts[row, col])
        gates[:len(toa), row, col] = toa
    return [histograms, histograms.to_events(SENSOR), PhotonGates(gates)]


def test_hot_pixels_are_found_in_every_form_of_photons_at_edges_and_in_pairs():
    for frame in forms(cube([(*pixel, slice(None), 3) for pixel in HOT])):
        found = hot_pixels(light_of(frame, SENSOR), SENSOR)
        assert [*zip(*map(np.ndarray.tolist, np.nonzero(found)))] == HOT
    masked = SENSOR.replace(mask=np.ones((16, 20), bool) & ~found)
    assert not hot_pixels(light_of(frame, masked), masked).any()


@pytest.mark.parametrize("extra", [
    (), [(5, 5, slice(49, 52), 200)],                               # a retro-reflector
    [(5, 5, slice(None), 4), (5, 5, slice(49, 52), 300)],           # a white spot in the sun
    [(8, slice(None), slice(None), 4)],                             # a line in the sun
    [(slice(0, 8), slice(0, 10), slice(None), 4)]])                 # a window
def test_bright_surfaces_and_bright_regions_are_no_hot_pixels(extra):
    assert not hot_pixels(light_of(PhotonHistograms(cube(extra)), SENSOR), SENSOR).any()


def test_arrays_of_few_rows_have_no_neighbours_to_compare():
    sensor = SensorModel(1, 20, 80, 1e-10, [1])
    assert not hot_pixels(light_of(PhotonHistograms(cube()[:1]), sensor), sensor).any()


@pytest.mark.parametrize(("at", "said"), [(0, "first bin"), (-1, "last bin"), (20, "")])
def test_photons_in_one_end_bin_are_a_leak(at, said):
    warning = leak(light_of(PhotonHistograms(cube([(slice(None), slice(None), at, 2)])), SENSOR))
    assert (said in warning) and bool(warning) == bool(said)


def test_a_pulse_at_the_end_of_the_bins_is_no_leak():
    counts = cube()
    counts[..., :3] += np.array([4, 2, 1], np.uint16)
    assert not leak(light_of(PhotonHistograms(counts), SENSOR))


@pytest.mark.parametrize(("toa", "said"), [
    (np.linspace(0.1, 7.9, 60), True), (np.linspace(0.1, 7.9, 6), False), (np.linspace(0.1, 79, 60), False)])
def test_times_that_fill_a_small_part_of_the_bins_may_be_nanoseconds(toa, said):
    events = PhotonEvents(np.zeros(len(toa), np.uint32), toa.astype(np.float32))
    assert bool(other_unit(events, SENSOR)) == said
    assert not other_unit(PhotonEvents(events.pixel, toa.astype(np.uint16)), SENSOR)


def test_a_stream_is_looked_at_for_a_second_and_then_once_a_second():
    dark, bright = (PhotonHistograms(cube(extra)) for extra in ((), [(3, 7, slice(None), 1)]))
    leaking = PhotonHistograms(cube([(slice(None), slice(None), 0, 2)]))
    watch = LightWatch(SENSOR)
    assert [watch.look(frame, now_s) for frame, now_s in ((bright, 7), (bright, 7.5), (dark, 8), (leaking, 8.5))] == [
        False, False, True, False]
    assert [*zip(*np.nonzero(watch.hot))] == [(3, 7)] and watch.warning == ""
    assert not watch.masked(SENSOR).used[3, 7] and watch.masked(SENSOR.replace(mask=watch.hot)).used.sum() == 1
    assert not watch.look(leaking, 9) and "first bin" in watch.warning
    assert not watch.look(dark, 3) and watch.warning == ""      # a clock that was set back
    assert LightWatch(SENSOR).masked(SENSOR) is SENSOR
