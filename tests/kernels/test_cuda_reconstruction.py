"""Whole reconstructions by the CUDA kernels against the CPU's and the float64 reference's, frame after frame."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import torch

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.kernels.constants import REST_SCALES, SURE_SCALES

from .frames import DEPTH_TOLERANCE, FAINT, RELATIVE, SHARE_AT_TIES, T, make_sensor, make_sketch
from .on_device import others

# Of what takes the interpreter long.
QUICK = {"WINDOWS": ((2.0, 1), (4.0, 1)), "SURE_SCALES": SURE_SCALES[:2], "REST_SCALES": REST_SCALES[:1],
         "FIRST_STEPS": 1}
ALL_SCALES = {"SURE_SCALES": SURE_SCALES, "REST_SCALES": REST_SCALES, "FIRST_STEPS": 2}
FIELDS = ("row", "col", "surface", "depth_bins", "intensity", "depth_std_bins", "xyz", "background")


def shorten(cuda, monkeypatch, spread=0, **settings):
    """Reconstruct in less time than it takes to interpret all steps; on a GPU as always."""
    if cuda.device.DEVICE == "cpu":
        for kernels in (cuda, *others()):
            monkeypatch.setattr(import_module(f"{kernels.__name__}.birth_death"), "SPREAD", spread)
        for name, value in (QUICK | settings).items():
            monkeypatch.setattr(f"srt3d_ros.core.pooled.{name}", value)


def built(monkeypatch, kernels, sensor, frequencies, device="cuda", **options) -> Pooled:
    monkeypatch.setattr("srt3d_ros.core.pooled.kernels_for", lambda wanted: (device, kernels))
    return Pooled(sensor, frequencies, **options)


def assert_clouds_agree(one: PointCloud, other: PointCloud, surfaces: int, points: int):
    for k in range(surfaces):
        depth = [cloud.image("depth_bins", k) for cloud in (one, other)]
        there = np.isfinite(depth[0])
        wrong = there != np.isfinite(depth[1])
        agree = np.abs(circular_difference(*depth, T)) <= DEPTH_TOLERANCE
        for field in ("intensity", "depth_std_bins"):
            ours, theirs = (cloud.image(field, k) for cloud in (one, other))
            agree &= np.abs(ours - theirs) <= RELATIVE * theirs
        wrong |= there & ~agree
        assert there.sum() > points / (k + 1) and wrong.sum() <= max(there.sum() * SHARE_AT_TIES, 1), np.argwhere(wrong)
    np.testing.assert_allclose(one.background, other.background, atol=1e-3 * one.background.max())


@pytest.mark.parametrize(("shape", "surfaces", "light", "options"), [
    ((3, 24), 1, 1, {}), ((3, 30), 1, FAINT, {}), ((2, 24), 2, 1, {}), ((4, 24), 1, 1, {"background": "estimate"})])
def test_whole_reconstructions_agree(cuda, monkeypatch, shape, surfaces, light, options):
    if options or surfaces > 1:
        shorten(cuda, monkeypatch)
    else:
        shorten(cuda, monkeypatch, spread=1, WINDOWS=((2.0, 2), (4.0, 2)), **ALL_SCALES)
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    if options:
        pytest.importorskip("numba")        # for the background's estimate
    there = replace(sketch, sums=cuda.array(sketch.sums), photons=cuda.array(sketch.photons))
    ours = built(monkeypatch, cuda, sensor, sketch.frequencies, surfaces=surfaces, **options)(there)
    for kernels in others():
        theirs = built(monkeypatch, kernels, sensor, sketch.frequencies, "cpu", surfaces=surfaces, **options)(sketch)
        assert_clouds_agree(ours, theirs, surfaces, 25)
        assert all(getattr(ours, name).dtype == getattr(theirs, name).dtype for name in FIELDS[:-2])


def assert_same(one: PointCloud, other: PointCloud):
    assert len(one) > 3
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_each_frame_gets_its_own_cloud_however_many_are_under_way(cuda, monkeypatch):
    shorten(cuda, monkeypatch)
    sensor = make_sensor(1, 9, seed=1)
    sketches = [replace(make_sketch(sensor, seed), stamp_ns=seed) for seed in (1, 2, 3)]
    srt3d = built(monkeypatch, cuda, sensor, sketches[0].frequencies)
    clouds = [wait() for wait in reversed([srt3d.submit(sketch) for sketch in sketches])][::-1]
    assert [cloud.stamp_ns for cloud in clouds] == [1, 2, 3]
    for sketch, cloud in list(zip(sketches, clouds))[:2]:
        assert_same(cloud, srt3d(sketch))
    assert len({cloud.background.tobytes() for cloud in clouds}) == 3


def test_frames_begin_with_the_last_ones_surfaces(cuda, monkeypatch):
    kernels = pytest.importorskip("srt3d_ros.kernels.cpu", reason="numba")
    shorten(cuda, monkeypatch)
    sensor = make_sensor(1, 24, seed=1)
    sketches = [make_sketch(sensor, seed, light) for seed, light in ((1, 1), (2, 0.2), (3, 0.2))]
    ours, theirs = (built(monkeypatch, own, sensor, sketches[0].frequencies, device, warm_start=True)
                    for own, device in ((cuda, "cuda"), (kernels, "cpu")))
    waits = [ours.submit(sketch) for sketch in sketches]
    for wait, sketch in zip(waits, sketches):
        assert_clouds_agree(wait(), theirs(sketch), 1, 8)


def test_a_sketch_may_lie_anywhere_and_change_once_it_is_submitted_and_warming_up_changes_nothing(cuda, monkeypatch):
    shorten(cuda, monkeypatch)
    if cuda.device.DEVICE == "cpu":
        monkeypatch.setattr(cuda, "WARM_FRAMES", 1)
    sensor = make_sensor(1, 9, seed=1)
    sketch = make_sketch(sensor, 1)
    srt3d = built(monkeypatch, cuda, sensor, sketch.frequencies)
    expected = srt3d(sketch)

    sums, photons = sketch.sums.copy(), sketch.photons.copy()
    photons.flags.writeable = False
    wait = srt3d.submit(replace(sketch, sums=sums, photons=photons))
    sums[:] = 0
    assert_same(wait(), expected)

    there = replace(sketch, sums=cuda.array(sketch.sums), photons=cuda.array(sketch.photons))
    assert isinstance(there.sums, torch.Tensor)
    srt3d.warm_up()
    cloud = srt3d(there)
    assert_same(cloud, expected)
    assert all(isinstance(getattr(cloud, name), np.ndarray) for name in FIELDS)
