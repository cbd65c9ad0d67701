"""What the photons of a frame say before they are sketched: their score, and up to which frequency the IRF holds."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import POOLED_PIXELS, design_sketch, measure
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from tests.photon_forms import as_histograms

T, SIDE = 600, 40
TAIL = np.exp(-np.arange(80) / 15)              # a sharp edge and a long tail
SENSOR = SensorModel(SIDE, SIDE, T, 1e-10, TAIL)


def frame(signal: float, background: float, irf=TAIL, seed=0) -> PhotonEvents:
    """Mean photons of a pixel, of a surface at another depth in each."""
    rng = np.random.default_rng(seed)
    depth = rng.integers(100, 300, SENSOR.pixels)
    of_surface, of_light = (rng.integers(0, SENSOR.pixels, round(n * SENSOR.pixels)) for n in (signal, background))
    toa = depth[of_surface] + rng.choice(len(irf), len(of_surface), p=irf / irf.sum())
    toa = np.concatenate([toa, rng.integers(0, T, len(of_light))])
    return PhotonEvents(np.concatenate([of_surface, of_light]).astype(np.uint32), toa.astype(np.uint16))


@pytest.mark.parametrize(("signal", "background"), [(20, 10), (3, 6), (40, 0)])
def test_pairs_of_photons_tell_the_signal_at_whatever_depth(signal, background):
    photons = signal + background
    expected = signal / photons * np.sqrt(2 * POOLED_PIXELS * photons)
    for form in (frame(signal, background), as_histograms(frame(signal, background), SENSOR)):
        assert measure(form, SENSOR, None, 60)[0] == pytest.approx(expected, rel=0.05)


def test_a_mask_leaves_pixels_out_and_a_gate_background():
    events, mask = frame(20, 20), np.ones((SIDE, SIDE), bool)
    pixel, toa = np.zeros(10**5, np.uint32), np.full(10**5, 7, np.uint16)
    bright = PhotonEvents(np.append(events.pixel, pixel), np.append(events.toa, toa))
    mask[0, 0] = False
    masked = SENSOR.replace(mask=mask)
    assert measure(bright, masked, None, 60) == pytest.approx(measure(events, SENSOR, None, 60), rel=0.01)
    assert measure(events, SENSOR, Gate(SENSOR, 90, 389), 60)[0] > 1.1 * measure(events, SENSOR, None, 60)[0]


def test_the_irf_is_confirmed_as_far_as_the_photons_are_like_it():
    assert measure(frame(50, 5), SENSOR, None, 40)[1] > 25
    assert measure(frame(50, 5, irf=np.exp(-np.arange(80) / 9)), SENSOR, None, 40)[1] < 15
    for photons in (frame(0, 20), frame(0, 0.1), frame(0, 0)):
        assert measure(photons, SENSOR, None, 40)[1] == 0


def test_auto_follows_many_photons_that_are_as_the_irf_says():
    few = choose_frequencies("auto", SENSOR)
    many = design_sketch(SENSOR, frame=frame(50, 25)).frequencies
    assert len(many) == 10 and many[0] == 1 and many[-1] > 1.4 * few[-1]
    assert design_sketch(SENSOR, frame=frame(1, 1)).frequencies == few
    assert design_sketch(SENSOR, frame=frame(50, 25, irf=np.exp(-np.arange(80) / 9))).frequencies == few
    assert design_sketch(SENSOR, frequencies="1,2", frame=frame(50, 25)).frequencies == (1, 2)
    gated = design_sketch(SENSOR, (90, 389), frame=frame(50, 25)).frequencies
    assert max(gated) > max(choose_frequencies("auto", SENSOR)) / 2
