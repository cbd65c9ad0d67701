"""Sketched maximum likelihood pixel by pixel: the minimum it finds."""

import numpy as np

from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum
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
