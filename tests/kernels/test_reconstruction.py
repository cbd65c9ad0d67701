"""Whole reconstructions against the reference's, frame after frame; that they repeat, and that CUDA can record them."""

from dataclasses import replace
from functools import partial
from importlib import import_module

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.frequencies import consecutive
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.kernels import reference

from .frames import FAINT, SHAPES, assert_clouds_agree, cases, make_sensor, make_sketch

# Of what takes the interpreter long.
QUICK = {"WINDOWS": ((2.0, 1), (4.0, 1)), "FIRST_STEPS": 1, "PASSES": 2}
QUICKEST = QUICK | {"WINDOWS": ((2.0, 1),)}
FIELDS = ("row", "col", "surface", "depth_bins", "intensity", "depth_std_bins", "xyz", "background")


@pytest.fixture
def shorten(cuda, monkeypatch, spreading):
    """Makes reconstructions shorter, so that they can be interpreted; on a GPU they are as always."""
    def change(settings: dict, spread: int = 0) -> None:
        if cuda.device.DEVICE == "cpu":
            spreading(spread)
            monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.birth_death"), "PER_THREAD", 1 << 10)
            for name, value in settings.items():
                monkeypatch.setattr(f"srt3d_ros.core.pooled.{name}", value)
    return change


def built(monkeypatch, kernels, sensor, frequencies, *arguments, **options) -> Pooled:
    device = "cuda" if kernels.__name__.endswith("cuda") else "cpu"
    monkeypatch.setattr("srt3d_ros.core.pooled.kernels_for", lambda wanted: (device, kernels))
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
    there = replace(sketch, sums=backend.on(sketch.sums), photons=backend.on(sketch.photons))
    ours = built(monkeypatch, backend.kernels, sensor, sketch.frequencies, surfaces, **options)(there)
    theirs = built(monkeypatch, reference, sensor, sketch.frequencies, surfaces, **options)(sketch)
    assert_clouds_agree(ours, theirs, surfaces, 25)
    assert ours.xyz.dtype == ours.depth_bins.dtype == np.float32 and ours.row.dtype == np.uint16


@pytest.mark.parametrize(("backend", "shape", "surfaces"), cases([((2, 24), 1)], [((9, 33), 2)]), indirect=["backend"])
def test_backgrounds_are_taken_out_and_learnt_alike(backend, monkeypatch, shorten, shape, surfaces):
    if backend.name == "cuda":
        shorten(QUICKEST)
    sensor = make_sensor(*shape, seed=5).replace(background_shape=np.exp(-np.arange(300) / 40))
    sketch, found = make_sketch(sensor, 5), []
    for kernels in (backend.kernels, reference):
        reconstructor = built(monkeypatch, kernels, sensor, sketch.frequencies, surfaces)
        found.append((reconstructor.submit(sketch)(), reconstructor.uneven_background))
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
        waits = reconstructor.submit(first), reconstructor.submit(second)
        clouds.append([wait() for wait in waits][1])
    assert_clouds_agree(*clouds, surfaces, 8)
    without = built(monkeypatch, backend.kernels, sensor, first.frequencies, surfaces)(second)
    assert not np.array_equal(without.depth_bins, clouds[0].depth_bins)


def assert_same(one: PointCloud, other: PointCloud):
    assert len(one) > 3
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_each_frame_gets_its_own_cloud_and_a_sketch_may_lie_anywhere_and_change(cuda, monkeypatch, shorten):
    shorten(QUICKEST)
    if cuda.device.DEVICE == "cpu":
        monkeypatch.setattr(cuda, "WARM_FRAMES", 1)
    sensor = make_sensor(1, 9, seed=1)
    sketches = [replace(make_sketch(sensor, seed), stamp_ns=seed) for seed in (1, 2, 3)]
    srt3d = built(monkeypatch, cuda, sensor, sketches[0].frequencies, background="flat")
    clouds = [wait() for wait in reversed([srt3d.submit(sketch) for sketch in sketches])][::-1]
    assert [cloud.stamp_ns for cloud in clouds] == [1, 2, 3]
    assert len({cloud.background.tobytes() for cloud in clouds}) == 3

    sums, photons = sketches[0].sums.copy(), sketches[0].photons.copy()
    photons.flags.writeable = False
    wait = srt3d.submit(replace(sketches[0], sums=sums, photons=photons))
    sums[:] = 0
    assert_same(wait(), clouds[0])

    there = replace(sketches[1], sums=cuda.array(sketches[1].sums), photons=cuda.array(sketches[1].photons))
    srt3d.warm_up()
    cloud = srt3d(there)
    assert_same(cloud, clouds[1])
    assert all(isinstance(getattr(cloud, name), np.ndarray) for name in FIELDS)


# What a CUDA graph records must neither wait for the GPU, as these do, nor read the host's memory.
WAITING = {"_local_scalar_dense", "equal", "is_nonzero", "nonzero", "masked_select", "bincount", "repeat_interleave",
           "unique_dim", "_unique2", "lift_fresh"}


class Watch(TorchDispatchMode):
    """Notes the names of torch's operations; none may choose by a mask, whose length the host would wait for."""

    def __init__(self):
        super().__init__()
        self.names = set()

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        name = function.overloadpacket.__name__
        self.names.add(name)
        assert not name.startswith("index") or all(each is None or each.dtype != torch.bool for each in args[1])
        assert name != "_to_copy" or not (kwargs or {}).get("device"), "copies between host and device"
        return function(*args, **(kwargs or {}))


@pytest.mark.parametrize(("surfaces", "warm", "clutter"), [(1, False, False), (2, True, True)])
def test_a_reconstruction_can_be_recorded(cuda, monkeypatch, surfaces, warm, clutter):
    kernel = import_module("srt3d_ros.kernels.cuda.birth_death")._choose
    monkeypatch.setattr(type(kernel), "run", lambda *args, **options: None)
    sensor = SensorModel(6, 40, 300, 1e-10, np.ones(9))
    srt3d = built(monkeypatch, cuda, sensor, consecutive(5), surfaces)
    tensor = partial(torch.zeros, device=cuda.device.DEVICE)
    frame = [tensor(6, 40, dtype=torch.uint32), tensor(6, 40, 5, dtype=torch.complex64)]
    if clutter:         # and a background that is taken out
        frame += [tensor(6, 40), tensor(5, dtype=torch.complex64), tensor(300) + 1]
    srt3d._points(warm, *frame)                             # finds memory, copies constants
    kept = {name: values.data_ptr() for name, values in srt3d._scratch._tensors.items()}

    with Watch() as watch:
        srt3d._points(warm, *frame)
    assert len(watch.names) > 20 and not watch.names & WAITING, watch.names & WAITING
    assert {name: values.data_ptr() for name, values in srt3d._scratch._tensors.items()} == kept
