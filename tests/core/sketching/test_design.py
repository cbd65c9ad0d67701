"""Gate and frequencies for a sensor, and what the photons of a frame say before they are sketched."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.design import (
    POOLED_PIXELS,
    design_sketch,
    histogram,
    measure,
    occupied,
    signal_to_background,
)
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.core.sketching.plausibility import LightWatch, hot_pixels, leak, light_of, other_unit
from srt3d_ros.errors import InvalidInput
from tests.photon_forms import as_gates, as_histograms

ROWS, COLS, T = 8, 10, 500
SENSOR = SensorModel(ROWS, COLS, T, 1e-10, [1, 2, 4, 2, 1])
SHARP = SensorModel(ROWS, COLS, 200, 1e-10, [1, 2, 1])


def frame(*depths, background=20_000) -> PhotonEvents:
    """An even background, and 600 photons at each depth of SENSOR."""
    rng = np.random.default_rng(0)
    pulses = [d + rng.choice(5, 600, p=SENSOR.irf) - SENSOR.irf_ref for d in depths]
    toa = np.concatenate([rng.integers(0, T, background), *pulses])
    return PhotonEvents(rng.integers(0, SENSOR.pixels, len(toa), dtype=np.uint32), toa.astype(np.uint16))


def seen(seed=0, background=20_000, scene=()) -> np.ndarray:
    """The histogram of an even background and (photons, bin) of each part of a scene."""
    counts = np.bincount(np.random.default_rng(seed).integers(0, 200, background), minlength=200)
    for photons, bin in scene:
        counts[bin] += photons
    return counts


def gate_of(events, sensor=SENSOR, **options):
    return design_sketch(sensor, "auto", frame=events, **options).gate


def test_without_auto_the_sensor_alone_counts():
    assert design_sketch(SENSOR) == (None, choose_frequencies("auto", SENSOR))
    gate, frequencies = design_sketch(SENSOR, "100:299", "auto", 5)
    assert gate.sensor.num_bins == 200 and frequencies == choose_frequencies("auto", gate.sensor, 5)
    assert design_sketch(SENSOR, (100, 299), "consecutive", 5).frequencies == (1, 2, 3, 4, 5)


def test_auto_finds_the_scene_has_room_and_is_no_gate_where_nothing_can_be_gained():
    gate, frequencies = design_sketch(SENSOR, "auto", frame=frame(200, 240))
    assert 170 < gate.first <= 196 and 244 <= gate.last < 270
    assert frequencies == choose_frequencies("auto", gate.sensor) != choose_frequencies("auto", SENSOR)
    for events in (frame(), frame(20, 120, 220, 320, 420, 480), frame(200, background=50)):
        assert design_sketch(SENSOR, "auto", frame=events) == (None, choose_frequencies("auto", SENSOR))
    assert gate_of(frame(3, 9)).first == 0 and gate_of(frame(496, 480)).last == T - 1
    assert gate_of(frame(200), SENSOR.replace(irf=np.concatenate([SENSOR.irf, np.zeros(150)]))).num_bins >= 155
    assert gate_of(frame(200), frequencies="1,2,80").num_bins >= 161
    assert gate_of(frame(200), sketch_size=30).num_bins >= 61


@pytest.mark.parametrize(("settings", "line"), [
    (("auto",), "gate is auto: expected off, FIRST-LAST (100-400), or auto (files only)"),
    (("-3:50",), "gate is -3:50: expected a first bin of 0 or more and below the last"),
    (("300:302",), "gate is 300-302: expected 5 bins or more, as many as the IRF has"),
    (("300:309", "auto", 10), "sketch_size is 10: expected 1 to 4 for T = 10 bins"),
    (("300:399", "1,60"), "frequencies is 60: expected integers from 1 to 49 (T = 100 bins; higher ones repeat these)"),
])
def test_a_gate_that_cannot_be_used_is_one_line(settings, line):
    with pytest.raises(InvalidInput) as error:
        design_sketch(SENSOR, *settings)
    assert str(error.value) == line


def test_frequencies_of_which_the_irf_passes_none_are_refused_as_methods_refuse_them():
    assert design_sketch(SHARP, "off", "1,99").frequencies == (1, 99)
    with pytest.raises(InvalidInput, match=r"frequencies is \[98, 99\]: expected some that the sensor's IRF passes"):
        design_sketch(SHARP, "off", "98,99")


# ---- The histogram of a frame

def test_masked_pixels_are_left_out_and_delays_taken_off():
    events = frame(60, background=0)
    row, col = np.divmod(events.pixel, COLS)
    late, mask = np.zeros((ROWS, COLS), np.float32), np.ones((ROWS, COLS), bool)
    late[3], mask[:, 4] = 470, False
    sensor = SENSOR.replace(delay_bins=late, mask=mask)
    toa = np.where(row == 3, (events.toa + 30) % T, events.toa)[col != 4]
    expected = np.bincount(toa, minlength=T)
    for form in (events, PhotonEvents(events.pixel, events.toa.astype(np.float32)),
                 as_histograms(events, sensor)):
        assert np.array_equal(histogram(form, sensor), expected)


def test_even_background_alone_occupies_nothing():
    assert [occupied(seen(seed, 4000), 2) for seed in range(100)].count(None) >= 99


@pytest.mark.parametrize(("background", "photons"), [(40_000, 120), (4000, 45), (400, 20), (20, 8), (0, 5)])
def test_few_photons_at_one_depth_are_seen_at_any_background(background, photons):
    for seed in range(10):
        first, last = occupied(seen(seed, background, [(photons, 70), (3 * photons, 90)]), 2)
        assert 68 <= first <= 70 and 90 <= last <= 92, seed


def test_faint_parts_and_fog_are_seen_and_hide_none():
    first, last = occupied(seen(scene=[(2000, 70)]), 2)
    assert 68 <= first and last <= 72
    first, last = occupied(seen(scene=[(2000, 70), *((20, b) for b in range(110, 140))]), 2)
    assert 68 <= first and 125 <= last <= 155
    fog = np.round(1200 * np.exp(-np.arange(150) / 25)).astype(int)
    first, last = occupied(seen(scene=[(1500, 100), *((n, 20 + b) for b, n in enumerate(fog))]), 2)
    assert first <= 21 and last >= 100


def test_the_sbr_is_what_stands_out_of_the_emptiest_quarter():
    assert signal_to_background(seen(scene=[(10_000, 70)]), SHARP) == pytest.approx(0.5, rel=0.1)
    assert signal_to_background(seen(), SHARP) == 0
    assert signal_to_background(seen(background=0, scene=[(9, 70)]), SHARP) == np.inf


SIDE = 40
TAIL = np.exp(-np.arange(80) / 15)              # a sharp edge and a long tail
TAILED = SensorModel(SIDE, SIDE, 600, 1e-10, TAIL)


def frame_of(signal: float, background: float, irf=TAIL, seed=0) -> PhotonEvents:
    """Mean photons of a pixel, of a surface at another depth in each."""
    rng = np.random.default_rng(seed)
    depth = rng.integers(100, 300, TAILED.pixels)
    of_surface, of_light = (rng.integers(0, TAILED.pixels, round(n * TAILED.pixels)) for n in (signal, background))
    toa = depth[of_surface] + rng.choice(len(irf), len(of_surface), p=irf / irf.sum())
    toa = np.concatenate([toa, rng.integers(0, 600, len(of_light))])
    return PhotonEvents(np.concatenate([of_surface, of_light]).astype(np.uint32), toa.astype(np.uint16))


@pytest.mark.parametrize(("signal", "background"), [(20, 10), (3, 6), (40, 0)])
def test_pairs_of_photons_tell_the_signal_at_whatever_depth(signal, background):
    photons = signal + background
    expected = signal / photons * np.sqrt(2 * POOLED_PIXELS * photons)
    for form in (frame_of(signal, background), as_histograms(frame_of(signal, background), TAILED)):
        assert measure(form, TAILED, None, 60)[0] == pytest.approx(expected, rel=0.05)


def test_a_mask_leaves_pixels_out_and_a_gate_background():
    events, mask = frame_of(20, 20), np.ones((SIDE, SIDE), bool)
    pixel, toa = np.zeros(10**5, np.uint32), np.full(10**5, 7, np.uint16)
    bright = PhotonEvents(np.append(events.pixel, pixel), np.append(events.toa, toa))
    mask[0, 0] = False
    masked = TAILED.replace(mask=mask)
    assert measure(bright, masked, None, 60) == pytest.approx(measure(events, TAILED, None, 60), rel=0.01)
    assert measure(events, TAILED, Gate(TAILED, 90, 389), 60)[0] > 1.1 * measure(events, TAILED, None, 60)[0]


def test_the_irf_is_confirmed_as_far_as_the_photons_are_like_it():
    assert measure(frame_of(50, 5), TAILED, None, 40)[1] > 25
    assert measure(frame_of(50, 5, irf=np.exp(-np.arange(80) / 9)), TAILED, None, 40)[1] < 15
    for photons in (frame_of(0, 20), frame_of(0, 0.1), frame_of(0, 0)):
        assert measure(photons, TAILED, None, 40)[1] == 0


def test_auto_follows_many_photons_that_are_as_the_irf_says():
    few = choose_frequencies("auto", TAILED)
    many = design_sketch(TAILED, frame=frame_of(50, 25)).frequencies
    assert len(many) == 10 and many[0] == 1 and many[-1] > 1.4 * few[-1]
    assert design_sketch(TAILED, frame=frame_of(1, 1)).frequencies == few
    assert design_sketch(TAILED, frame=frame_of(50, 25, irf=np.exp(-np.arange(80) / 9))).frequencies == few
    assert design_sketch(TAILED, frequencies="1,2", frame=frame_of(50, 25)).frequencies == (1, 2)
    gated = design_sketch(TAILED, (90, 389), frame=frame_of(50, 25)).frequencies
    assert max(gated) > max(choose_frequencies("auto", TAILED)) / 2


# ---- Hot pixels, leaks and times in another unit, and what looks like them

BOX = SensorModel(16, 20, 80, 1e-10, [1, 2, 1], gates=GateWords())
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
    events = histograms.to_events(BOX)
    return [histograms, events, as_gates(events, BOX)]


def test_hot_pixels_are_found_in_every_form_of_photons_at_edges_and_in_pairs():
    for frame in forms(cube([(*pixel, slice(None), 3) for pixel in HOT])):
        found = hot_pixels(light_of(frame, BOX), BOX)
        assert [*zip(*map(np.ndarray.tolist, np.nonzero(found)))] == HOT
    masked = BOX.replace(mask=np.ones((16, 20), bool) & ~found)
    assert not hot_pixels(light_of(frame, masked), masked).any()


@pytest.mark.parametrize("extra", [
    (), [(5, 5, slice(49, 52), 200)],                               # a retro-reflector
    [(5, 5, slice(None), 4), (5, 5, slice(49, 52), 300)],           # a white spot in the sun
    [(8, slice(None), slice(None), 4)],                             # a line in the sun
    [(slice(0, 8), slice(0, 10), slice(None), 4)]])                 # a window
def test_bright_surfaces_and_bright_regions_are_no_hot_pixels(extra):
    assert not hot_pixels(light_of(PhotonHistograms(cube(extra)), BOX), BOX).any()


def test_arrays_of_few_rows_have_no_neighbours_to_compare():
    line = SensorModel(1, 20, 80, 1e-10, [1])
    assert not hot_pixels(light_of(PhotonHistograms(cube()[:1]), line), line).any()


@pytest.mark.parametrize(("at", "photons", "said"), [
    (0, 2, "first bin"), (-1, 2, "last bin"), (20, 2, ""), (slice(3), [4, 2, 1], "")])     # a pulse at the end
def test_photons_in_one_end_bin_are_a_leak(at, photons, said):
    warning = leak(light_of(PhotonHistograms(cube([(slice(None), slice(None), at, np.uint16(photons))])), BOX))
    assert (said in warning) and bool(warning) == bool(said)


@pytest.mark.parametrize(("toa", "said"), [
    (np.linspace(0.1, 7.9, 60), True), (np.linspace(0.1, 7.9, 6), False), (np.linspace(0.1, 79, 60), False)])
def test_times_that_fill_a_small_part_of_the_bins_may_be_nanoseconds(toa, said):
    events = PhotonEvents(np.zeros(len(toa), np.uint32), toa.astype(np.float32))
    assert bool(other_unit(events, BOX)) == said
    assert not other_unit(PhotonEvents(events.pixel, toa.astype(np.uint16)), BOX)


def test_a_floor_of_the_irf_is_warned_of_until_it_is_taken_off():
    pulse = np.exp(-0.5 * ((np.arange(60) - 30) / 2)**2)
    for irf, said in ((pulse, False), (pulse + 0.01, True), (pulse[20:40], False)):
        watch = LightWatch(BOX.replace(irf=irf, irf_ref=None))
        watch.look(PhotonHistograms(cube()), 7)
        watch.look(PhotonHistograms(cube()), 8)
        assert ("irf has a floor" in watch.warning) == said


def test_a_stream_is_looked_at_for_a_second_and_then_once_a_second():
    dark, bright = (PhotonHistograms(cube(extra)) for extra in ((), [(3, 7, slice(None), 1)]))
    leaking = PhotonHistograms(cube([(slice(None), slice(None), 0, 2)]))
    watch = LightWatch(BOX)
    assert [watch.look(frame, now_s) for frame, now_s in ((bright, 7), (bright, 7.5), (dark, 8), (leaking, 8.5))] == [
        False, False, True, False]
    assert [*zip(*np.nonzero(watch.hot))] == [(3, 7)] and watch.warning == ""
    assert not watch.masked(BOX).used[3, 7] and watch.masked(BOX.replace(mask=watch.hot)).used.sum() == 1
    assert not watch.look(leaking, 9) and "first bin" in watch.warning
    assert not watch.look(dark, 3) and watch.warning == ""      # a clock that was set back
    watch.look(PhotonEvents(np.zeros(60, np.uint32), np.linspace(0.1, 7.9, 60, dtype=np.float32)), 5)
    assert "nanoseconds" in watch.warning
    assert LightWatch(BOX).masked(BOX) is BOX
