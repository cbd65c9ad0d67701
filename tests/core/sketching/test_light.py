"""The light of a frame: photons per pixel, share of the signal, where the IRF is right, from pairs of photons."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching import light as light_module
from srt3d_ros.core.sketching.frequency_design import Light, highest_passed
from srt3d_ros.core.sketching.light import light_of
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonGates
from tests.core.scenes import simulate

T = 400
BELL = np.exp(-0.5 * ((np.arange(41) - 20) / 4.0)**2)


def make(rows=60, cols=60, irf=BELL, **changes) -> SensorModel:
    return SensorModel(rows, cols, T, 1e-10, irf, **changes)


def frame(sbr: float, ppp: float, sensor=None, behind=(), seed=0) -> PhotonEvents:
    """Photons of pixels that see any depth, each its own, and surfaces so many bins behind it."""
    sensor = make() if sensor is None else sensor
    depth = np.random.default_rng(7).uniform(0, T, (1, sensor.rows, sensor.cols))
    return simulate((depth + np.array([0, *behind])[:, None, None]) % T, sbr, ppp, sensor, seed)


@pytest.mark.parametrize(("sbr", "ppp"), [(0.1, 30), (1, 3), (1, 100), (10, 1)])
def test_a_scene_that_spreads_over_all_bins_tells_its_light(sbr, ppp):
    light = light_of(frame(sbr, ppp), make())
    assert light.photons_per_pixel == pytest.approx(ppp, rel=0.05)
    assert light.signal_share == pytest.approx(sbr / (1 + sbr), rel=0.1)
    assert light.sbr == pytest.approx(light.signal_share / (1 - light.signal_share))


def test_background_alone_has_no_signal():
    seen = [light_of(frame(1e-9, ppp, seed=seed), make()) for ppp in (0.5, 5, 50) for seed in range(4)]
    assert sum(light.signal_share > 0 for light in seen) <= 1 and not any(light.confirmed for light in seen)


@pytest.mark.parametrize("events", [PhotonEvents(np.zeros(0, np.uint32), np.zeros(0, np.uint16)),
                                    PhotonEvents(np.arange(9, dtype=np.uint32), np.zeros(9, np.uint16))])
def test_without_pairs_of_photons_there_is_no_light(events):
    light = light_of(events, make())
    assert (light.signal_share, light.confirmed) == (0, 0) and light.sbr == 0
    assert light.photons_per_pixel == pytest.approx(events.photons / 3600)


def test_many_photons_confirm_the_irf_up_to_what_it_passes():
    sensor = make()
    confirmed = [light_of(frame(2, ppp), sensor).confirmed for ppp in (0.5, 5, 50)]
    assert confirmed == sorted(confirmed) and confirmed[0] < 15 and confirmed[-1] >= 0.8 * highest_passed(sensor)


def test_two_surfaces_in_a_pixel_or_fog_do_not_confirm_the_irf():
    assert light_of(frame(2, 50, behind=(25,)), make()).confirmed < 5
    fog = make(background_shape=np.exp(-np.arange(T) / 100))
    assert light_of(frame(0.5, 50, fog), make()).confirmed == 0


@pytest.mark.parametrize("true_irf", [np.exp(-0.5 * ((np.arange(41) - 20) / 3.0)**2),       # sharper, and wider
                                      np.exp(-0.5 * ((np.arange(41) - 20) / 6.0)**2)])
def test_photons_of_another_pulse_do_not_confirm_the_irf(true_irf):
    light = light_of(frame(2, 50, make(irf=true_irf)), make())
    assert light.confirmed < 12 and light.signal_share == pytest.approx(2 / 3, rel=0.1)


def test_a_bright_pixel_counts_as_its_photons():
    hot = np.zeros(20_000, np.uint32)
    events = frame(10, 10)
    rng = np.random.default_rng(0)
    both = PhotonEvents(np.concatenate([hot, events.pixel]),
                        np.concatenate([rng.integers(0, T, len(hot)).astype(np.uint16), events.toa]))
    assert light_of(both, make()).signal_share > 0.6            # by pairs it would be 0.03
    mask = np.arange(3600).reshape(60, 60) > 0
    masked = light_of(both, make(mask=mask))
    assert masked.signal_share == pytest.approx(10 / 11, rel=0.05)
    assert masked.photons_per_pixel == pytest.approx(10, rel=0.05)


def test_gates_and_events_of_any_order_tell_the_same():
    sensor = make(gates=GateWords(first_word=3, no_detection=0))
    events = frame(1, 5, sensor)
    order = np.random.default_rng(0).permutation(events.photons)
    expected = light_of(events, sensor)
    assert light_of(PhotonEvents(events.pixel[order], events.toa[order]), sensor) == expected
    assert light_of(PhotonGates.from_events(events, sensor), sensor) == expected


@pytest.mark.parametrize("as_gates", [False, True])
@pytest.mark.parametrize(("name", "most"), [("MOST_PHOTONS", 5000), ("MOST_PIXELS", 300)])
def test_of_many_photons_or_pixels_some_are_looked_at(as_gates, name, most, monkeypatch):
    monkeypatch.setattr(light_module, name, most)
    looked_at, sketch_photons = [], light_module.sketch_photons
    monkeypatch.setattr(light_module, "sketch_photons",
                        lambda *given: looked_at.append(sketch_photons(*given)) or looked_at[0])
    sensor = make(gates=GateWords(first_word=0, no_detection=65_535))
    events = frame(1, 20, sensor)
    light = light_of(PhotonGates.from_events(events, sensor) if as_gates else events, sensor)
    assert 0.4 * most < (looked_at[0].photons.sum() if name == "MOST_PHOTONS" else looked_at[0].photons.size) <= most
    assert light.photons_per_pixel == pytest.approx(20, rel=0.05) and light.signal_share == pytest.approx(0.5, rel=0.15)


def test_octaves_count_doublings_of_photons_and_of_what_a_sketch_keeps():
    light = Light(10, 0.5, 40)
    assert light.octaves(10) == pytest.approx(np.log2(0.25 * 2 * 10 * 4 * 10 / 100))
    assert light.octaves(40) == pytest.approx(light.octaves(10) + 2)
    assert Light(0, 0, 0).octaves(10) < -10


def test_a_gate_keeps_the_signal():
    light = Light(10, 0.2, 80).gated(0.25)
    assert light.photons_per_pixel * light.signal_share == pytest.approx(2)
    assert light.photons_per_pixel == pytest.approx(2 + 8 / 4) and light.confirmed == 20
