"""Whole reconstructions by the CUDA kernels against the CPU's and the float64 reference's, frame after frame."""

import numpy as np
import pytest
import torch

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.srt3d import SRT3D

from .frames import DEPTH_TOLERANCE, FAINT, RELATIVE, SHARE_AT_TIES, T, make_sensor, make_sketch
from .on_device import others

QUICK = {"SPREAD": 0, "WINDOWS": ((2.0, 1), (4.0, 1))}          # of what takes the interpreter long
FIELDS = ("row", "col", "surface", "depth_bins", "intensity", "depth_std_bins", "xyz", "background")


def shorten(cuda, monkeypatch, **settings):
    """Reconstruct in less time than it takes to interpret all steps; on a GPU as always."""
    if cuda.DEVICE == "cpu":
        for name, value in (QUICK | settings).items():
            monkeypatch.setattr(f"srt3d_ros.core.srt3d.{name}", value)


def built(monkeypatch, kernels, sensor, frequencies, device="cuda", **options) -> SRT3D:
    monkeypatch.setattr("srt3d_ros.core.srt3d.kernels_for", lambda wanted: (device, kernels))
    return SRT3D(sensor, frequencies, **options)


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
    ((4, 24), 1, 1, {}), ((4, 30), 1, FAINT, {}), ((3, 24), 2, 1, {}), ((3, 24), 1, 1, {"weighting": "precision"}),
    ((4, 24), 1, 1, {"background": "estimate"})])
def test_whole_reconstructions_agree(cuda, monkeypatch, shape, surfaces, light, options):
    if options:
        shorten(cuda, monkeypatch)
    else:
        shorten(cuda, monkeypatch, SPREAD=1, WINDOWS=((2.0, 2), (3.0, 2), (4.0, 2)))
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    if options:
        pytest.importorskip("numba")
    ours = built(monkeypatch, cuda, sensor, sketch.frequencies, surfaces=surfaces, **options)(sketch)
    for kernels in others():
        theirs = built(monkeypatch, kernels, sensor, sketch.frequencies, "cpu", surfaces=surfaces, **options)(sketch)
        assert_clouds_agree(ours, theirs, surfaces, 30)
        assert all(getattr(ours, name).dtype == getattr(theirs, name).dtype for name in FIELDS[:-2])


def test_each_frame_gets_its_own_cloud_however_many_are_under_way(cuda, monkeypatch):
    shorten(cuda, monkeypatch)
    sensor = make_sensor(2, 9, seed=1)
    sketches = [make_sketch(sensor, seed) for seed in (1, 2, 3)]
    sketches = [Sketch(s.frequencies, s.sums, s.photons, stamp_ns=n) for n, s in enumerate(sketches)]
    srt3d = built(monkeypatch, cuda, sensor, sketches[0].frequencies)
    alone = [srt3d(sketch) for sketch in sketches]
    waits = [srt3d.submit(sketch) for sketch in sketches]
    for wait, expected in reversed(list(zip(waits, alone))):
        cloud = wait()
        assert cloud.stamp_ns == expected.stamp_ns and len(cloud) > 5
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(cloud, name), getattr(expected, name), err_msg=name)
    assert len({cloud.background.tobytes() for cloud in alone}) == len(alone)


@pytest.mark.parametrize("background", ["flat", "estimate"])
def test_sketches_that_lie_on_the_device_are_taken_from_there(cuda, monkeypatch, background):
    shorten(cuda, monkeypatch)
    sensor = make_sensor(2, 9, seed=1)
    sketch = make_sketch(sensor, 1)
    there = Sketch(sketch.frequencies, cuda.array(sketch.sums), cuda.array(sketch.photons))
    srt3d = built(monkeypatch, cuda, sensor, sketch.frequencies, background=background)
    one, other = srt3d(sketch), srt3d(there)
    assert isinstance(there.sums, torch.Tensor) and all(isinstance(getattr(other, name), np.ndarray) for name in FIELDS)
    for name in FIELDS:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_what_is_submitted_may_change_and_may_be_read_only(cuda, monkeypatch):
    shorten(cuda, monkeypatch)
    sensor = make_sensor(2, 9, seed=1)
    sketch = make_sketch(sensor, 1)
    srt3d = built(monkeypatch, cuda, sensor, sketch.frequencies)
    expected = srt3d(sketch)
    sums, photons = sketch.sums.copy(), sketch.photons.copy()
    photons.flags.writeable = False
    wait = srt3d.submit(Sketch(sketch.frequencies, sums, photons))
    sums[:] = 0
    assert np.array_equal(wait().depth_bins, expected.depth_bins)


def test_warming_up_changes_nothing(cuda, monkeypatch):
    shorten(cuda, monkeypatch)
    sensor = make_sensor(2, 5, seed=1)
    sketch = make_sketch(sensor, 1)
    srt3d = built(monkeypatch, cuda, sensor, sketch.frequencies)
    before = srt3d(sketch)
    srt3d.warm_up()
    assert np.array_equal(srt3d(sketch).depth_bins, before.depth_bins)
