"""The frames have the photons that they should: as many, where the simulator puts them, in the order that is said."""

import numpy as np

from srt3d_ros.benchmark.frames import SBR, SEED, gates_of, gates_sensor, photons_of, sensor_of, shuffled
from srt3d_ros.datasets.simulator import Simulator


def near_surface(events, depth):
    """Share of each row's photons that lie within 100 bins of their pixel's surface."""
    row = events.pixel // depth.shape[-1]
    near = np.abs(events.toa - depth.ravel()[events.pixel]) < 100
    return np.bincount(row, near) / np.bincount(row)


def test_photons_drawn_in_bands_are_those_of_the_scene():
    sensor, ppp = sensor_of(24), 1000
    simulator = Simulator(sensor=sensor, sbr=SBR, ppp=ppp, seed=SEED)
    depth, signal, background = simulator.expected(0)
    events = photons_of(sensor, ppp, band_photons=75_000)                   # 3 rows at a time
    assert events.is_sorted
    events.check(sensor)
    expected = (signal[0] + background).sum(axis=1)
    by_row = np.bincount(events.pixel // sensor.cols, minlength=sensor.rows)
    assert (np.abs(by_row - expected) < 6 * np.sqrt(expected)).all()
    at_once, _ = simulator.frame(0)
    assert np.abs(near_surface(events, depth) - near_surface(at_once, depth)).max() < 0.02
    few = photons_of(sensor, 0.05, band_photons=1)                          # rows without any
    assert 5 < few.photons < 60 and few.is_sorted


def test_shuffled_photons_are_the_same_in_no_order():
    events = photons_of(sensor_of(12), 5)
    mixed = shuffled(events)
    assert not mixed.is_sorted
    assert sorted(zip(mixed.pixel, mixed.toa)) == sorted(zip(events.pixel, events.toa))


def test_gates_have_the_photons_in_any_cycle():
    sensor = gates_sensor()
    gates = gates_of(sensor, ppp=3, cycles=200)
    seen = gates.words != sensor.gates.no_detection
    assert gates.words.shape == (200, 32, 32) and gates.words[seen].max() < sensor.num_bins
    assert abs(seen.sum() / sensor.pixels - 3) < 0.3
    assert 0.8 < seen[:100].sum() / seen[100:].sum() < 1.25
