"""Whole reconstructions against the reference's, frame after frame."""

from importlib import import_module

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.kernels import reference

from .frames import FAINT, SHAPES, assert_clouds_agree, cases, make_sensor, make_sketch

# Of what takes the interpreter long.
QUICK = {"WINDOWS": ((2.0, 1), (4.0, 1)), "FIRST_STEPS": 1, "PASSES": 2}
QUICKEST = QUICK | {"WINDOWS": ((2.0, 1),)}


@pytest.fixture
def shorten(cuda, monkeypatch, spreading):
    """Makes reconstructions shorter, so that they can be interpreted; on a GPU they are as always."""
    def change(settings: dict, spread: int = 0) -> None:
        if cuda.device.DEVICE == "cpu":
            spreading(spread)
            monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.birth_death"), "PER_THREAD", 1 << 10)
            for name, value in settings.items():
                monkeypatch.setattr(f"srt3d_ros.core.method.pooled.{name}", value)
    return change


def built(monkeypatch, kernels, sensor, frequencies, *arguments, **options) -> Pooled:
    device = "cuda" if kernels.__name__.endswith("cuda") else "cpu"
    monkeypatch.setattr("srt3d_ros.core.method.pooled.kernels_for", lambda wanted: (device, kernels))
    return Pooled(sensor, frequencies, *arguments, **options)


@pytest.mark.parametrize(("backend", "shape", "surfaces", "light", "options"), cases(
    [((3, 24), 1, FAINT, {}), ((2, 24), 2, 1, {}), ((2, 24), 1, 1, {"background": "flat"})],
    [(SHAPES[0], 1, 1, {}), (SHAPES[1], 1, FAINT, {}), (SHAPES[0], 2, 0.1, {})]),
    indirect=["backend"])
def test_whole_reconstructions_agree(backend, monkeypatch, shorten, shape, surfaces, light, options):
    if backend.name == "cuda":
        shorten(QUICK, spread=0 if surfaces > 1 else 1)
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    ours = built(monkeypatch, backend.kernels, sensor, sketch.frequencies, surfaces, **options)(sketch)
    theirs = built(monkeypatch, reference, sensor, sketch.frequencies, surfaces, **options)(sketch)
    assert_clouds_agree(ours, theirs, surfaces, 25)
    assert ours.xyz.dtype == ours.depth_bins.dtype == np.float32 and ours.row.dtype == np.uint16


@pytest.mark.parametrize(("backend", "shape", "surfaces"), cases([((2, 24), 1)], [((9, 33), 2)]), indirect=["backend"])
def test_backgrounds_are_taken_out_and_learnt_alike(backend, monkeypatch, shorten, shape, surfaces):
    if backend.name == "cuda":
        shorten(QUICKEST)
    sensor = make_sensor(*shape, seed=5).replace(background_shape=np.exp(-np.arange(300) / 40))
    sketch, found = make_sketch(sensor, 5), []
    monkeypatch.setattr("srt3d_ros.core.method.pooled.PASSES", 1)      # so few pixels end at an even background
    for kernels in (backend.kernels, reference):
        reconstructor = built(monkeypatch, kernels, sensor, sketch.frequencies, surfaces)
        found.append((reconstructor(sketch), reconstructor.uneven_background))
    (ours, uneven), (theirs, expected) = found
    assert_clouds_agree(ours, theirs, surfaces, 25)
    assert uneven == pytest.approx(expected, rel=1e-3) and uneven > 0.05


@pytest.mark.parametrize(("backend", "shape", "surfaces"), cases([((1, 24), 1)], [((6, 40), 2)]), indirect=["backend"])
def test_frames_begin_with_the_last_ones_surfaces(backend, monkeypatch, shorten, shape, surfaces):
    if backend.name == "cuda":
        shorten(QUICKEST)
    sensor = make_sensor(*shape, seed=5)
    first, second = make_sketch(sensor, 5), make_sketch(sensor, 6, 0.2)
    clouds = []
    for kernels in (backend.kernels, reference):
        reconstructor = built(monkeypatch, kernels, sensor, first.frequencies, surfaces, warm_start=True)
        reconstructor(first)
        clouds.append(reconstructor(second))
    assert_clouds_agree(*clouds, surfaces, 8)
    without = built(monkeypatch, backend.kernels, sensor, first.frequencies, surfaces)(second)
    assert not np.array_equal(without.depth_bins, clouds[0].depth_bins)
