"""The kernels of the baselines against the equations in their docstrings, and on surfaces that are known exactly."""

import numpy as np
import pytest

from srt3d_ros.core.baselines import plug_and_play
from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.sketched import SMLE, SRT3D, weighted_steps
from srt3d_ros.core.baselines.xcorr import by_pixel
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.kernels import cpu, maps
from srt3d_ros.kernels import torch as oracle
from tests.core.scenes import matched_frame, simulate

from .frames import CPU, ORACLE, T, padded

SCALE = 5.0         # bins that count as one pixel


def make_sensor(rows, cols, irfs=1):
    rng = np.random.default_rng(rows)
    irf = np.exp(-np.linspace(-2, 4, 25)**2) * rng.uniform(0.8, 1, (irfs, 25))
    return SensorModel(rows, cols, T, 1e-10, irf if irfs > 1 else irf[0], gain=rng.uniform(0.5, 1.5, (rows, cols)),
                       delay_bins=rng.uniform(-3, 3, (rows, cols)), mask=rng.random((rows, cols)) > 0.05 * (cols > 1))


def make_points(sensor, surfaces):
    """Points of up to three layers, one across the end of the period; some astray, some missing."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:sensor.rows, :sensor.cols]
    layers = np.stack([(290 + 0.6 * x - 0.4 * y) % T, 80 - 1.5 * y, np.full(x.shape, 150.0)][:surfaces], axis=1)
    size = layers.shape
    depth = np.where(rng.random(size) < 0.1, rng.uniform(0, T, size), layers + rng.normal(0, 1.5, size))
    intensity = np.where(rng.random(size) < 0.85, rng.uniform(1, 60, size), 0) * (sensor.exposure > 0)[:, None]
    return (depth % T).astype(np.float32), intensity.astype(np.float32)


def pad(layers):
    """float32 [rows, K, cols] → [rows', K, cols']."""
    return maps.pad(layers.swapaxes(1, 2))


def apss(kernels, depth, intensity, normal, seen):
    """`apss` of maps without padding."""
    normal = normal if normal is None else np.stack([pad(part) for part in normal])
    needed = plug_and_play.points_needed(seen)
    *found, normal = kernels.apss(pad(depth), pad(intensity), normal, needed, SCALE, T)
    *found, u, v = (maps.crop(each, *seen.shape) for each in (*found, *normal))
    return *found, np.stack([u, v])


def make_photons(sensor, ppp=25):
    y, x = np.mgrid[:sensor.rows, :sensor.cols]
    return simulate(np.stack([290 + 0.6 * x - 0.4 * y, 80 - 1.5 * y]) % T, 3, ppp, sensor, seed=1)


def assert_moved(points, before, move, grown, most):
    """All points have moved by `move`, limited to `most`, and have the intensities `grown`."""
    there = before[1] > 0
    wanted = before[0] + np.where(there, move.clip(-most, most), 0)
    assert there.sum() > 5 and np.abs(move[there]).max() > 1e-3
    np.testing.assert_allclose(circular_difference(points[0], wanted, T), 0, atol=1e-3)
    np.testing.assert_allclose(points[1], np.where(there, grown, 0), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("shape", "surfaces", "precise", "usual"), [
    ((8, 40), 1, False, 20.0), ((8, 33), 2, True, 0.0), ((1, 9), 3, True, 20.0), ((5, 9), 2, False, 0.0)])
def test_pixelwise(backend, shape, surfaces, precise, usual):
    sensor, frequencies = make_sensor(*shape), tuple(range(1, 8))
    frame = matched_frame(sensor, sketch_photons(make_photons(sensor), sensor, frequencies))
    table = weighted_steps(sensor, frequencies, precise)
    t, r = make_points(sensor, surfaces)
    z, energy = frame.matched[:, :7] + 1j * frame.matched[:, 7:], frame.energy[:, None].astype(float)
    g = frame.exposure[:, None]

    def phases(depth):
        return np.exp(2j * np.pi * frame.bin_frequencies[:, None] * depth.astype(float)[:, :, None])

    def gap(depth, intensity):
        """z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k), complex [rows, m, cols]."""
        return z - energy * ((g * intensity)[:, :, None] * phases(depth)).sum(axis=1)

    turned = gap(t, r)[:, None] * phases(t).conj()
    level = ((g * r / np.maximum(frame.counts[:, None], 1)).clip(0, 1) * (len(table) - 1) + 0.5).astype(int)
    a = table[level].transpose(3, 0, 1, 4, 2)                                           # [4, rows, K, m, cols]
    error_rt, error_r = (a[0::2] * turned.real + a[1::2] * turned.imag).sum(axis=3)
    if not precise:             # the steps are the gradient of Σ |gap|² / |ĥ|², divided by its curvature
        nudge, omega = 1e-4, 2 * np.pi * frame.bin_frequencies[:, None]
        for k in range(surfaces):
            for error, curvature, along in ((error_rt, (g * r)[:, k] * (omega**2 * energy).sum(), t),
                                            (error_r, g[:, 0] * energy.sum(), r)):
                ahead, behind = (along.astype(float) + sign * nudge * (np.arange(surfaces) == k)[:, None]
                                 for sign in (1, -1))
                values = [(np.abs(gap(*((x, r) if along is t else (t, x))))**2 / energy).sum(axis=1)
                          for x in (ahead, behind)]
                slope = (values[0] - values[1]) / (2 * nudge)
                np.testing.assert_allclose(-slope / 2, error[:, k] * curvature, rtol=1e-3, atol=1e-2)

    grown = np.maximum(r + 0.5 * error_r / np.maximum(g, 1e-12), 0)
    signal = g * np.maximum(r, grown)
    move = 0.3 * error_rt * signal / (np.maximum(signal, usual * g)**2 + 1e-12)
    points = (maps.crop(each, *shape) for each in backend.pixelwise(padded(frame), table, 0.3, usual, pad(t), pad(r)))
    assert_moved(tuple(points), (t, r), move, grown, frame.resolution_bins)


@pytest.mark.parametrize(("shape", "irfs", "surfaces", "ppp"), [
    ((4, 9), 1, 1, 25), ((8, 21), 168, 2, 25), ((2, 5), 1, 3, 2)])
def test_poisson(shape, irfs, surfaces, ppp):
    sensor = make_sensor(*shape, irfs)
    data = RT3D(sensor)._likelihood(by_pixel(make_photons(sensor, ppp), sensor), ratio=0.01)
    t, r = make_points(sensor, surfaces)
    background = np.random.default_rng(2).uniform(0.001, 0.1, shape).astype(np.float32)
    stray, signal, score = np.zeros(shape), np.zeros(r.shape), np.zeros(r.shape)
    entries = np.arange(data.irf.shape[1])
    for p, (i, j) in enumerate(np.ndindex(shape)):
        own = p if irfs > 1 else 0
        for x in data.toa[data.starts[p]:data.starts[p + 1]]:
            place = (x.astype(float) - t[i, :, j] + data.ref) % T
            h, slope = (np.interp(place, entries, of[own]) for of in (data.irf, data.slope))
            total = background[i, j] + (r[i, :, j] * h).sum()
            stray[i, j] += background[i, j] / total
            signal[i, :, j] += r[i, :, j] * h / total
            score[i, :, j] -= r[i, :, j] * slope / total
    g = data.exposure[:, None]
    move = 0.3 * score / (np.maximum(signal, 20 * g) * data.information + 1e-12)
    change = 0.5 * (signal - g * r) / (np.maximum(g * r, 20 * g) + 1e-12)
    points = pad(t), pad(r)
    found = cpu.poisson(data, background, 0.3, 20.0, *points)
    after = [maps.crop(each, *shape) for each in points]
    assert_moved(after, (t, r), move, r * np.exp(np.minimum(change, 1)), data.information**-0.5)
    np.testing.assert_allclose(found, stray * (data.exposure > 0), rtol=1e-3, atol=1e-3)


# ---- APSS

def make_plane(shape):
    """A plane across the end of the period, [rows, 1, cols], and its normals."""
    y, x = np.mgrid[:shape[0], :shape[1]]
    normal = np.array([-2.0, 1.0]) / SCALE / np.sqrt(1 + (2 / SCALE)**2 + (1 / SCALE)**2)
    return ((290 + 2.0 * x - y) % T).astype(np.float32)[:, None], \
        np.broadcast_to(normal[:, None, None, None], (2, shape[0], 1, shape[1])).astype(np.float32)


@pytest.mark.parametrize("spheres", [False, True])
@pytest.mark.parametrize("shape", [(20, 30), (1, 9), (9, 1)])
def test_apss_keeps_a_plane_with_its_normals_and_leaves_out_masked_pixels(backend, shape, spheres):
    plane, normal = make_plane(shape)
    seen = np.ones(shape, np.float32)
    seen[0, 0] = min(shape) == 1            # a line's second pixel would see too few points beside a masked one
    lit = 10 * seen[:, None]
    depth, intensity, facing = apss(backend, plane, lit, normal if spheres else None, seen)
    np.testing.assert_allclose(intensity, lit, rtol=1e-5)
    there = intensity > 0
    np.testing.assert_allclose(circular_difference(depth, plane, T)[there], 0, atol=0.01)
    if spheres or min(shape) > 1:           # a line fits planes of any slope across it
        np.testing.assert_allclose(facing[:, there], normal[:, there], atol=0.01)
    assert (depth[~there] == 0).all() and (facing[:, ~there] == 0).all()


def test_apss_keeps_two_surfaces_apart_the_strongest_first(backend):
    depth = np.tile(np.array([100, 200], np.float32)[:, None], (6, 1, 7))
    intensity = np.tile(np.array([5, 20], np.float32)[:, None], (6, 1, 7))
    intensity[2, :, 3] = 50, 0
    out = apss(backend, depth, intensity, None, np.ones((6, 7), np.float32))
    usual = np.ones((6, 7), bool)
    usual[1:4, 2:5] = False
    for k, (t, r) in enumerate([(200, 20), (100, 5)]):
        np.testing.assert_allclose(out[0][:, k][usual], t, atol=0.01)
        np.testing.assert_allclose(out[1][:, k][usual], r, rtol=1e-5)
    np.testing.assert_allclose(out[0][2, :, 3], [100, 200], atol=0.01)
    np.testing.assert_allclose(out[1][2, :, 3], [0.9 * 50 + 0.1 * 5, 0.1 * 20], rtol=1e-5)


def test_spheres_keep_a_ball_round_where_planes_flatten_it(backend):
    y, x = np.mgrid[-6:7, -6:7]
    radius = 20.0
    ball = (150 - SCALE * np.sqrt(radius**2 - x**2 - y**2)).astype(np.float32)[:, None]
    lit, seen = np.ones(ball.shape, np.float32), np.ones(x.shape, np.float32)
    normal = np.stack([x / radius, y / radius])[:, :, None].astype(np.float32) * -1
    inside = np.s_[2:-2, 0, 2:-2]
    by_spheres = np.abs(apss(backend, ball, lit, normal, seen)[0] - ball)[inside]
    by_planes = np.abs(apss(backend, ball, lit, None, seen)[0] - ball)[inside]
    assert by_spheres.max() < 0.01 < 0.05 < by_planes.max()


def test_apss_creates_points_among_four_and_removes_those_among_three(backend):
    depth, intensity = np.full((3, 1, 3), 100, np.float32), np.zeros((3, 1, 3), np.float32)
    seen = np.ones((3, 3), np.float32)
    intensity[0, 0], intensity[1, 0, 0] = 10, 10
    out = apss(backend, depth, intensity, None, seen)
    assert out[1][1, 0, 1] == pytest.approx(1.0) and out[0][1, 0, 1] == pytest.approx(100)
    intensity[1, 0, 0] = 0
    assert apss(backend, depth, intensity, None, seen)[1][1, 0, 1] == 0
    intensity[2, 0, 0], depth[2, 0, 0] = 10, 160                    # a fourth one far behind is another surface's
    assert apss(backend, depth, intensity, None, seen)[1][1, 0, 1] == 0


@pytest.mark.parametrize("method", [SRT3D, SMLE])
@pytest.mark.parametrize("surfaces", [1, 2])
def test_a_gpu_finds_the_same_points_and_looks_at_no_value(monkeypatch, method, surfaces):
    sensor = make_sensor(12, 33)
    monkeypatch.setattr(plug_and_play, "ITERATIONS", 4)
    sketch = sketch_photons(make_photons(sensor, 60), sensor, tuple(range(1, 8)))

    def on(kernels):
        monkeypatch.setattr("srt3d_ros.core.method.matched_frame.kernels_for", lambda name: kernels)
        return method(sensor, sketch.frequencies, surfaces, device="cuda")

    found, expected = (on(each.kernels)(sketch) for each in (CPU, ORACLE))
    on(oracle.on("meta")).run(np.float32(sketch.photons), sketch.sums)        # torch's device without values
    assert len(found) > 300
    for field in ("row", "col", "surface"):
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))
    assert np.abs(circular_difference(found.depth_bins, expected.depth_bins, T)).max() < 1e-3
    for field in ("intensity", "background", "xyz"):
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), rtol=1e-3, atol=1e-3)
