"""The kernels of the baselines against the oracle, step by step, and whole reconstructions.

float32 leaves depths in [0, 300) exact to 3e-5 bins; where points hang on small differences ten times that. Decisions
that rounding tells apart (a point on the border of a cluster, a projection that just goes on) may fall either way.
"""

import numpy as np
import pytest

from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.toa import by_pixel
from srt3d_ros.core.baselines.weighting import weighted_steps
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import consecutive
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.kernels import cpu
from tests.core.scenes import reconstruct, simulate

from .frames import ORACLE, SHARE_AT_TIES, T


def make_sensor(rows, cols, irfs=1):
    rng = np.random.default_rng(rows)
    irf = np.exp(-np.linspace(-2, 4, 25)**2) * rng.uniform(0.8, 1, (irfs, 25))
    return SensorModel(rows, cols, T, 1e-10, irf if irfs > 1 else irf[0], gain=rng.uniform(0.5, 1.5, (rows, cols)),
                       delay_bins=rng.uniform(-3, 3, (rows, cols)), mask=rng.random((rows, cols)) > 0.05 * (cols > 1))


def make_points(rows, cols, surfaces):
    """Points of up to three layers, one across the end of the period; some astray, some missing."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:rows, :cols]
    layers = np.stack([(290 + 0.6 * x - 0.4 * y) % T, 80 - 1.5 * y, np.full(x.shape, 150.0)][:surfaces], axis=1)
    size = layers.shape
    depth = np.where(rng.random(size) < 0.1, rng.uniform(0, T, size), layers + rng.normal(0, 1.5, size))
    intensity = np.where(rng.random(size) < 0.85, rng.uniform(1, 60, size), 0)
    intensity[:, 0] += 0.5                                                  # so that there is one
    return (depth % T).astype(np.float32), intensity.astype(np.float32)


def make_photons(sensor, ppp=25):
    y, x = np.mgrid[:sensor.rows, :sensor.cols]
    return simulate(np.stack([290 + 0.6 * x - 0.4 * y, 80 - 1.5 * y]) % T, 3, ppp, sensor, seed=1)


def assert_agree(fast, slow, exact_bins=3e-4, relative=3e-4):
    """Points are the same, but for ties; their depths and intensities agree."""
    (depth, intensity), (expected_depth, expected_intensity) = fast[:2], slow[:2]
    here, there = intensity > 0, expected_intensity > 0
    wrong = here != there
    wrong |= here & there & (np.abs(circular_difference(depth, expected_depth, T)) > exact_bins)
    wrong |= here & there & (np.abs(intensity - expected_intensity) > relative * expected_intensity)
    assert here.any() and wrong.sum() <= here.sum() * SHARE_AT_TIES, np.argwhere(wrong)


@pytest.mark.parametrize(("shape", "surfaces", "precise", "usual"), [
    ((8, 40), 1, False, 20.0), ((8, 33), 2, True, 0.0), ((1, 9), 3, True, 20.0)])
def test_pixelwise(backend, shape, surfaces, precise, usual):
    sensor, frequencies = make_sensor(*shape), consecutive(7)
    frame = Matcher(sensor, frequencies)(sketch_photons(make_photons(sensor), sensor, frequencies))
    table = weighted_steps(sensor, frequencies, precise)
    depth, intensity = make_points(*shape, surfaces)
    intensity *= (frame.exposure > 0)[:, None]
    found, expected = (kernels.changed("pixelwise", frame, table, 0.3, usual, depth, intensity)[-2:]
                       for kernels in (backend, ORACLE))
    assert not np.array_equal(found[0], depth)
    assert_agree(found, expected, exact_bins=1e-3, relative=1e-3)


@pytest.mark.parametrize(("shape", "irfs", "surfaces", "ppp"), [
    ((4, 9), 1, 1, 25), ((8, 21), 168, 2, 25), ((2, 5), 1, 3, 2)])
def test_poisson(backend, shape, irfs, surfaces, ppp):
    sensor = make_sensor(*shape, irfs)
    data = RT3D(sensor, device="cpu")._likelihood(by_pixel(make_photons(sensor, ppp), sensor), ratio=0.01)
    depth, intensity = make_points(*shape, surfaces)
    background = np.random.default_rng(2).uniform(0.001, 0.1, shape).astype(np.float32)
    arguments = data, background, 0.3, 20.0, depth, intensity
    np.testing.assert_allclose(backend.poisson(*arguments), ORACLE.poisson(*arguments), rtol=1e-4, atol=1e-5)
    found, expected = (kernels.changed("poisson", *arguments)[-2:] for kernels in (backend, ORACLE))
    assert not np.array_equal(found[0], depth)
    assert_agree(found, expected)


@pytest.mark.parametrize("spheres", [False, True])
@pytest.mark.parametrize(("shape", "surfaces"), [((20, 30), 1), ((20, 30), 3), ((1, 9), 2), ((9, 1), 1)])
def test_apss(backend, shape, surfaces, spheres):
    rng = np.random.default_rng(4)
    depth, intensity = make_points(*shape, surfaces)
    intensity[0, 0, 0] = 5
    exposure = (rng.random(shape) > 0.05 * (shape[1] > 1)).astype(np.float32)
    intensity *= (exposure > 0)[:, None]
    normal = rng.uniform(-0.3, 0.3, (2, *depth.shape)).astype(np.float32) if spheres else None
    arguments = depth, intensity, normal, exposure, 8.0, T
    fast, slow = backend.apss(*arguments), ORACLE.apss(*arguments)
    assert_agree(fast, slow, exact_bins=3e-3)
    close = np.abs(fast[2] - slow[2]).max(axis=0) < 1e-3
    assert (close | (slow[1] == 0)).mean() > 1 - SHARE_AT_TIES
    assert (fast[0][fast[1] == 0] == 0).all() and (fast[2][:, fast[1] == 0] == 0).all()


def test_spheres_keep_a_ball_round_where_planes_flatten_it():
    y, x = np.mgrid[-6:7, -6:7]
    scale, radius = 5.0, 20.0
    ball = (150 - scale * np.sqrt(radius**2 - x**2 - y**2)).astype(np.float32)[:, None]
    lit, seen = np.ones(ball.shape, np.float32), np.ones(x.shape, np.float32)
    normal = np.stack([x / radius, y / radius])[:, :, None].astype(np.float32) * -1
    inside = np.s_[2:-2, 0, 2:-2]
    by_spheres = np.abs(cpu.apss(ball, lit, normal, seen, scale, T)[0] - ball)[inside]
    by_planes = np.abs(cpu.apss(ball, lit, None, seen, scale, T)[0] - ball)[inside]
    assert by_spheres.max() < 0.01 < 0.05 < by_planes.max()


def test_apss_creates_points_among_four_and_removes_those_among_three():
    depth, intensity = np.full((3, 1, 3), 100, np.float32), np.zeros((3, 1, 3), np.float32)
    seen = np.ones((3, 3), np.float32)
    intensity[0, 0], intensity[1, 0, 0] = 10, 10
    out = cpu.apss(depth, intensity, None, seen, 5.0, T)
    assert out[1][1, 0, 1] == pytest.approx(1.0) and out[0][1, 0, 1] == pytest.approx(100)
    intensity[1, 0, 0] = 0
    assert cpu.apss(depth, intensity, None, seen, 5.0, T)[1][1, 0, 1] == 0
    intensity[2, 0, 0], depth[2, 0, 0] = 10, 160                    # a fourth one far behind is another surface's
    assert cpu.apss(depth, intensity, None, seen, 5.0, T)[1][1, 0, 1] == 0


@pytest.mark.parametrize("name", ["smle", "srt3d", "rt3d"])
def test_whole_reconstructions_agree(backend, monkeypatch, name):
    monkeypatch.setattr("srt3d_ros.core.baselines.plug_and_play.ITERATIONS", 1)
    sensor, clouds = make_sensor(4, 18), []
    for kernels in (backend.kernels, ORACLE.kernels):
        for module in ("rt3d", "sketched"):
            monkeypatch.setattr(f"srt3d_ros.core.baselines.{module}.kernels_for",
                                lambda device, found=kernels: (device, found))
        clouds.append(reconstruct(name, make_photons(sensor), sensor, consecutive(7), surfaces=2, device="cpu"))
    fast, slow = clouds
    assert len(fast) > 50
    for field in ("row", "col", "surface"):
        assert np.array_equal(getattr(fast, field), getattr(slow, field)), field
    for field in ("depth_bins", "intensity", "depth_std_bins", "background"):
        np.testing.assert_allclose(getattr(fast, field), getattr(slow, field), rtol=2e-3, atol=2e-3, err_msg=field)
