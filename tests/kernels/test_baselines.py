"""The kernels of the baselines against the plain reference, step by step."""

import numpy as np
import pytest

from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.toa import by_pixel
from srt3d_ros.core.frequencies import consecutive
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.methods import reconstruct
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.weighting import WEIGHTINGS, weighted_steps
from srt3d_ros.kernels import cpu, reference

from .baseline_frames import SHAPES, SHARE_AT_TIES, T, assert_agree, make_photons, make_points, make_sensor


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("surfaces", [1, 2, 3])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("usual", [0.0, 20.0])
def test_pixelwise(shape, surfaces, weighting, usual):
    sensor = make_sensor(*shape)
    frequencies = consecutive(7)
    frame = Matcher(sensor, frequencies)(sketch_photons(make_photons(sensor), sensor, frequencies))
    table = weighted_steps(sensor, frequencies, weighting).table
    depth, intensity = make_points(*shape, surfaces)
    intensity[:, 0][frame.exposure > 0] += 0.5                              # so that there is one
    intensity *= (frame.exposure > 0)[:, None]
    expected = depth.astype(np.float64), intensity.astype(np.float64)
    reference.pixelwise(frame, table, 0.3, usual, *expected)
    before = depth.copy()
    cpu.pixelwise(frame, table, 0.3, usual, depth, intensity)
    assert not np.array_equal(depth, before)
    assert_agree((depth, intensity), expected, exact_bins=1e-3, relative=1e-3)


@pytest.mark.parametrize("surfaces", [1, 2, 3])
@pytest.mark.parametrize(("shape", "irfs"), [(shape, 1) for shape in SHAPES] + [((8, 21), 168)])
def test_poisson(shape, irfs, surfaces):
    sensor = make_sensor(*shape, irfs)
    data = RT3D(sensor)._likelihood(by_pixel(make_photons(sensor), sensor), ratio=0.01)
    depth, intensity = make_points(*shape, surfaces)
    intensity[:, 0] += 0.5
    background = np.random.default_rng(2).uniform(0.001, 0.1, shape).astype(np.float32)
    expected = depth.astype(np.float64), intensity.astype(np.float64)
    stray = reference.poisson(data, background, 0.3, 20.0, *expected)
    before = depth.copy()
    np.testing.assert_allclose(cpu.poisson(data, background, 0.3, 20.0, depth, intensity), stray, rtol=1e-4, atol=1e-5)
    assert not np.array_equal(depth, before)
    assert_agree((depth, intensity), expected)


@pytest.mark.parametrize("spheres", [False, True])
@pytest.mark.parametrize("surfaces", [1, 2, 3])
@pytest.mark.parametrize("shape", [*SHAPES, (20, 30)])
def test_apss(shape, surfaces, spheres):
    rng = np.random.default_rng(4)
    depth, intensity = make_points(*shape, surfaces)
    intensity[0, 0, 0] = 5
    exposure = (rng.random(shape) > 0.05 * (shape[1] > 1)).astype(np.float32)
    intensity *= (exposure > 0)[:, None]
    normal = rng.uniform(-0.3, 0.3, (2, *depth.shape)).astype(np.float32) if spheres else None
    fast = cpu.apss(depth, intensity, normal, exposure, 8.0, T)
    slow = reference.apss(depth, intensity, normal, exposure, 8.0, T)
    assert_agree(fast, slow, exact_bins=3e-3)
    close = np.abs(fast[2] - slow[2]).max(axis=0) < 1e-3
    assert (close | (slow[1] == 0)).mean() > 1 - SHARE_AT_TIES


def test_apss_keeps_what_is_smooth_already():
    y, x = np.mgrid[:12, :15]
    plane = ((290 + 0.8 * x + 0.5 * y) % T).astype(np.float32)[:, None]
    lit = np.full(plane.shape, 7.0, np.float32)
    out = plane, lit, None
    for _ in range(3):                              # a pass with planes, then spheres through them
        out = cpu.apss(*out, np.ones((12, 15), np.float32), 6.0, T)
        assert np.abs(circular_difference(out[0], plane, T)).max() < 0.01        # the ridges' share
        np.testing.assert_allclose(out[1], 7.0, rtol=1e-5)


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
def test_whole_reconstructions_agree(monkeypatch, name):
    monkeypatch.setattr("srt3d_ros.core.baselines.plug_and_play.ITERATIONS", 1)
    sensor = make_sensor(4, 18)
    fast, slow = (reconstruct(name, make_photons(sensor), sensor, consecutive(7), surfaces=2, device=device)
                  for device in ("cpu", "reference"))
    assert len(fast) > 50
    for field in ("row", "col", "surface"):
        assert np.array_equal(getattr(fast, field), getattr(slow, field)), field
    for field in ("depth_bins", "intensity", "depth_std_bins", "background"):
        np.testing.assert_allclose(getattr(fast, field), getattr(slow, field), rtol=2e-3, atol=2e-3, err_msg=field)


def test_results_do_not_depend_on_the_number_of_threads():
    import numba
    depth, intensity = make_points(20, 30, 2)
    before = numba.get_num_threads()
    try:
        out = []
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            out.append(cpu.apss(depth, intensity, None, np.ones((20, 30), np.float32), 8.0, T))
    finally:
        numba.set_num_threads(before)
    assert all(np.array_equal(one, other) for one, other in zip(*out))
