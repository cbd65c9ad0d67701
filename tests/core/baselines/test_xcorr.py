"""The matched filter on full histograms against a plain one."""

import numpy as np

from srt3d_ros.core.baselines import xcorr
from srt3d_ros.core.baselines.xcorr import by_pixel
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from tests.core.scenes import T, make_sensor, ramp, run, simulate


def plain_filter(counts: np.ndarray, irf: np.ndarray, ref: int) -> float:
    """arg max_t Σ_b y_b log(1 + h(b − t) / (0.01 max h)), with a parabola through the peak."""
    response = np.zeros(len(counts))
    for t in range(len(counts)):
        for b in np.flatnonzero(counts):
            place = (b - t + ref) % len(counts)
            response[t] += counts[b] * np.log1p(irf[place] / (0.01 * irf.max())) if place < len(irf) else 0
    top = int(response.argmax())
    before, peak, after = response[top - 1], response[top], response[(top + 1) % len(counts)]
    bend = before - 2 * peak + after
    return top + np.clip((before - after) / 2 / bend if bend < 0 else 0, -0.5, 0.5)


def test_depths_are_those_of_a_plain_filter():
    sensor = make_sensor(5, 6)
    frame = simulate(ramp(5, 6, T - 10, 3.3, 0.7) % T, sbr=3, ppp=25)
    cloud = run("xcorr", frame, sensor)
    assert len(cloud) == len(np.unique(frame.pixel)) == 30          # each that saw a photon
    irf = sensor.irf.astype(float)
    for p in range(30):
        counts = np.bincount(frame.toa[frame.pixel == p], minlength=T)
        expected = plain_filter(counts, irf, sensor.irf_ref)
        assert abs(circular_difference(cloud.image("depth_bins").ravel()[p], expected, T)) < 0.01


def test_the_size_of_the_batches_does_not_matter(monkeypatch):
    sensor = make_sensor(7, 9)
    photons = by_pixel(simulate(ramp(7, 9, 200, 3, 1), sbr=2, ppp=25), sensor)
    method = xcorr.XCORR(sensor, 2)
    whole = method.peaks(photons)
    monkeypatch.setattr(xcorr, "CELLS", 4 * T)
    parts = method.peaks(photons)
    for part, expected in zip(parts, whole, strict=True):
        np.testing.assert_allclose(part, expected, rtol=1e-5)


def test_of_two_lone_photons_either_is_chosen_as_often():
    sensor = make_sensor(40, 40)
    toa = np.tile([100, 300], 1600).astype(np.uint16)
    cloud = run("xcorr", PhotonEvents(np.arange(1600, dtype=np.uint32).repeat(2), toa), sensor)
    assert len(cloud) == 1600 and 0.45 < (cloud.depth_bins < 200).mean() < 0.55
