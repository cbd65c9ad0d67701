"""Baselines: the minimum that smle finds, xcorr against a plain filter, SRT3D as published, and how good all are."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.core.baselines import xcorr
from srt3d_ros.core.baselines.plug_and_play import depth_scale_bins
from srt3d_ros.core.baselines.xcorr import by_pixel
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import Metrics, circular_difference, evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from tests.core.scenes import T, make_sensor, ramp, run, simulate


def test_precision_ends_where_its_gradient_vanishes():
    """Uᵀ Σ⁻¹ (z − Ψ) = 0 with Σ from a sum over all bins, at the depth and share that were found."""
    sensor = make_sensor(3, 4)
    frame = simulate(ramp(3, 4, 200, 20, 7), sbr=2, ppp=400)
    k = tuple(range(1, 7))
    sketch = sketch_photons(frame, sensor, k)
    cloud = run("smle", frame, sensor, 6)
    omega, spectrum = angular_frequencies(k, T), irf_spectrum(sensor, k)
    phases = np.exp(1j * np.outer(np.arange(T), omega))
    parts = np.concatenate([phases.real, phases.imag], axis=1)
    for p, z in enumerate(sketch.z.reshape(12, -1)):
        t, share = float(cloud.depth_bins[p]), cloud.intensity[p] / sketch.photons.ravel()[p]
        places = (np.arange(T) - t + sensor.irf_ref) % T
        density = np.interp(places, np.arange(len(sensor.irf)), sensor.irf, right=0)
        density = share * density / density.sum() + (1 - share) / T
        weights = np.linalg.inv((density[:, None] * parts).T @ parts - np.outer(density @ parts, density @ parts))
        model = spectrum * np.exp(1j * omega * t)
        gap = z - share * model
        slopes = np.stack([np.r_[d.real, d.imag] for d in (1j * omega * share * model, model)], axis=1)
        left = np.linalg.solve(slopes.T @ weights @ slopes, slopes.T @ weights @ np.r_[gap.real, gap.imag])
        assert abs(left[0]) < 0.05 and abs(left[1]) < 0.01           # what a full step would still change


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


def test_the_papers_numbers_of_steps_and_denoisings_are_run(monkeypatch):
    sensor, calls = make_sensor(8, 8), []
    method = METHODS["srt3d"].build(sensor, (1, 2, 3))
    kernels = method.kernels
    for name in ("pixelwise", "apss"):
        monkeypatch.setattr(kernels, name, lambda *args, name=name, kernel=getattr(kernels, name), **more: (
            calls.append(name) or kernel(*args, **more)))
    method(sketch_photons(simulate(np.full((8, 8), 200.0), 10, 20), sensor, (1, 2, 3)))
    assert calls == 5 * ["pixelwise"] + 25 * ["apss", "pixelwise"] + ["apss", "pixelwise"]


def test_depth_counts_by_the_distance_of_neighbouring_rays_within_what_the_peak_allows():
    sensor = SensorModel(40, 40, 600, 20e-12, np.ones(3), toa_offset_bins=400)
    pitch_bins = 500 * np.tan(np.radians(15)) / 20                      # 30° over 40 pixels at 500 bins
    assert depth_scale_bins(sensor, 100.0, peak_bins=40) == pytest.approx(6 * pitch_bins, rel=0.1)
    assert depth_scale_bins(sensor, 100.0, peak_bins=4) == 8
    assert depth_scale_bins(sensor, 100.0, peak_bins=400) == 200


# ---- On measured photons: TD at least, FD and DAE at most; m = 10, τ = 10 bins


def measured(folder, name: str, method: str) -> tuple[Metrics, object]:
    photons = read(folder / "photons" / f"{name}.npz")
    cloud = run(method, photons.frame, photons.sensor)
    return evaluate(cloud, photons.reference_depth_bins, 10, photons.sensor.num_bins), photons


def test_rt3d_is_as_good_as_its_authors_program_on_the_same_photons(shared_data):
    name = "art_real_unif_ppp5_sbr1"
    found, photons = measured(shared_data, name, "rt3d")
    with np.load(shared_data / "photons" / f"{name}.npz") as file:
        theirs = np.abs(file["rt3d_depth_bins"] - photons.reference_depth_bins[0])
    assert found.true_detections >= (theirs <= 10).mean() and found.false_detections <= (theirs > 10).mean()
    assert found.dae_bins <= 1.05 * theirs[theirs <= 10].mean()
