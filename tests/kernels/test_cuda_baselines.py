"""The CUDA kernels of the baselines against the float64 reference, step by step."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.baselines.rt3d import Likelihood
from srt3d_ros.core.baselines.toa import by_pixel, exposure, irf_slope
from srt3d_ros.core.frequencies import consecutive
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.methods import reconstruct
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.weighting import weighted_steps
from srt3d_ros.kernels import reference

from .baseline_frames import SHARE_AT_TIES, T, assert_agree, make_photons, make_points, make_sensor
from .on_device import frame_on


@pytest.mark.parametrize(("shape", "surfaces", "weighting", "usual"), [
    ((3, 40), 1, "identity", 20.0), ((3, 33), 2, "precision", 0.0), ((4, 7), 3, "precision", 20.0),
    ((1, 1), 1, "identity", 0.0)])
def test_pixelwise(cuda, shape, surfaces, weighting, usual):
    sensor = make_sensor(*shape)
    frequencies = consecutive(7)
    frame = Matcher(sensor, frequencies)(sketch_photons(make_photons(sensor), sensor, frequencies))
    table = weighted_steps(sensor, frequencies, weighting).table
    depth, intensity = make_points(*shape, surfaces)
    intensity[:, 0][frame.exposure > 0] += 0.5                              # so that there is one
    intensity *= (frame.exposure > 0)[:, None]
    expected = depth.astype(np.float64), intensity.astype(np.float64)
    reference.pixelwise(frame, table, 0.3, usual, *expected)
    points = cuda.array(depth), cuda.array(intensity)
    cuda.pixelwise(frame_on(cuda, frame), cuda.array(table), 0.3, usual, *points)
    found = [cuda.numpy(values) for values in points]
    assert not np.array_equal(found[0], depth)
    assert_agree(found, expected, exact_bins=1e-3, relative=1e-3)


@pytest.mark.parametrize(("shape", "irfs", "surfaces", "ppp"), [((4, 9), 1, 1, 25), ((3, 5), 15, 2, 100),
                                                                ((2, 5), 1, 3, 2)])
def test_poisson(cuda, shape, irfs, surfaces, ppp):
    sensor = make_sensor(*shape, irfs)
    photons, irf = by_pixel(make_photons(sensor, ppp), sensor), np.atleast_2d(sensor.irf)
    data = Likelihood(photons.starts, photons.toa, irf, irf_slope(irf).astype(np.float32), sensor.irf_ref, 0.05, T,
                      exposure(sensor))
    depth, intensity = make_points(*shape, surfaces)
    intensity[:, 0] += 0.5
    background = np.random.default_rng(2).uniform(0.001, 0.1, shape).astype(np.float32)
    expected = depth.astype(np.float64), intensity.astype(np.float64)
    stray = reference.poisson(data, background, 0.3, 20.0, *expected)
    points = cuda.array(depth), cuda.array(intensity)
    maps = {name: cuda.array(getattr(data, name)) for name in ("starts", "toa", "irf", "slope", "exposure")}
    found = cuda.poisson(replace(data, **maps), cuda.array(background), 0.3, 20.0, *points)
    np.testing.assert_allclose(cuda.numpy(found), stray, rtol=1e-4, atol=1e-5)
    found = [cuda.numpy(values) for values in points]
    assert not np.array_equal(found[0], depth)
    assert_agree(found, expected)


@pytest.mark.parametrize("spheres", [False, True])
@pytest.mark.parametrize(("shape", "surfaces"), [((4, 40), 1), ((5, 18), 2), ((4, 5), 3), ((1, 9), 1), ((9, 1), 1)])
def test_apss(cuda, shape, surfaces, spheres):
    rng = np.random.default_rng(4)
    depth, intensity = make_points(*shape, surfaces)
    intensity[0, 0, 0] = 5
    exposure = (rng.random(shape) > 0.05 * (shape[1] > 1)).astype(np.float32)
    intensity *= (exposure > 0)[:, None]
    normal = rng.uniform(-0.3, 0.3, (2, *depth.shape)).astype(np.float32) if spheres else None
    slow = reference.apss(depth, intensity, normal, exposure, 8.0, T)
    normal = cuda.array(normal) if spheres else None
    fast = cuda.apss(cuda.array(depth), cuda.array(intensity), normal, cuda.array(exposure), 8.0, T)
    fast = [cuda.numpy(values) for values in fast]
    assert_agree(fast, slow, exact_bins=3e-3)
    close = np.abs(fast[2] - slow[2]).max(axis=0) < 1e-3
    assert (close | (slow[1] == 0)).mean() > 1 - SHARE_AT_TIES
    assert (fast[0][fast[1] == 0] == 0).all() and (fast[2][:, fast[1] == 0] == 0).all()


@pytest.mark.parametrize("name", ["smle", "srt3d", "rt3d"])
def test_reconstructions_are_those_of_the_cpu(cuda, monkeypatch, name):
    pytest.importorskip("numba")
    from srt3d_ros.kernels import cpu
    monkeypatch.setattr("srt3d_ros.core.baselines.plug_and_play.ITERATIONS", 1)
    sensor, clouds = make_sensor(4, 18), []
    for kernels in (cuda, cpu):
        monkeypatch.setattr("srt3d_ros.core.baselines.options.kernels_for",
                            lambda device, found=kernels: (device, found))
        clouds.append(reconstruct(name, make_photons(sensor), sensor, consecutive(7), surfaces=2, device="cuda"))
    ours, theirs = clouds
    assert len(theirs) > 50
    for field in ("row", "col", "surface"):
        assert np.array_equal(getattr(ours, field), getattr(theirs, field)), field
    for field in ("depth_bins", "intensity", "depth_std_bins", "background"):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=2e-3, atol=2e-3, err_msg=field)
