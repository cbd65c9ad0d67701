"""Whole reconstructions against the oracle's; both backends keep the contract; and which device computes."""

import inspect
import logging
import re
from dataclasses import replace
from threading import Thread

import numpy as np
import pytest
import torch

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels import contract, cpu
from srt3d_ros.kernels import devices as device
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.kernels.devices import kernels_for
from srt3d_ros.reconstruction import Reconstructor

from .frames import CPU, FAINT, ORACLE, SHAPES, SINGLE, assert_clouds_agree, make_sensor, make_sketch


def built(monkeypatch, backend, sensor, frequencies, *arguments, **options) -> Pooled:
    monkeypatch.setattr("srt3d_ros.core.method.matched_frame.kernels_for", lambda device: backend.kernels)
    return Pooled(sensor, frequencies, *arguments, device="cpu", **options)


@pytest.mark.parametrize(("shape", "surfaces", "light", "options"), [
    (SHAPES[0], 1, 1, {}), (SHAPES[1], 1, FAINT, {}), (SHAPES[0], 2, 0.1, {}), ((13, 35), 3, 1, {}),
    ((2, 24), 1, 1, {"background": "flat"})])
def test_whole_reconstructions_agree(monkeypatch, shape, surfaces, light, options):
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    oracle, *others = (built(monkeypatch, kernels, sensor, sketch.frequencies, surfaces, **options)(sketch)
                       for kernels in (ORACLE, CPU, SINGLE))
    for cloud in others:
        assert_clouds_agree(cloud, oracle, min(surfaces, 2), 25)         # the scene has two layers
        assert cloud.xyz.dtype == cloud.depth_bins.dtype == np.float32 and cloud.row.dtype == np.uint16


@pytest.mark.parametrize(("shape", "surfaces"), [((9, 33), 1), ((9, 33), 2)])
def test_backgrounds_are_taken_out_and_learnt_alike(monkeypatch, shape, surfaces):
    sensor = make_sensor(*shape, seed=5).replace(background_shape=np.exp(-np.arange(300) / 40))
    sketch, found = make_sketch(sensor, 5), []
    monkeypatch.setattr("srt3d_ros.core.method.pooled.PASSES", 1)      # so few pixels end at an even background
    for kernels in (ORACLE, CPU, SINGLE):
        reconstructor = built(monkeypatch, kernels, sensor, sketch.frequencies, surfaces)
        found.append((reconstructor(sketch), reconstructor.uneven_background))
    for cloud, uneven in found[1:]:
        assert_clouds_agree(cloud, found[0][0], surfaces, 25)
        assert uneven == pytest.approx(found[0][1], rel=1e-3) and uneven > 0.05


def test_exposures_of_a_window_count_alike(monkeypatch):
    sensor = make_sensor(*SHAPES[0], seed=5)
    sketch = make_sketch(sensor, 5)
    exposure = np.linspace(1, 4, sensor.pixels, dtype=np.float32).reshape(sketch.photons.shape)
    oracle, *others = (built(monkeypatch, kernels, sensor, sketch.frequencies, window_frames=2)._cloud(
        replace(sketch, exposure=exposure)) for kernels in (ORACLE, CPU, SINGLE))
    for cloud in others:
        assert_clouds_agree(cloud, oracle, 1, 25)


def test_reconstructors_in_two_threads_do_not_meet():
    sensor = make_sensor(70, 80, seed=0)        # more than SERIAL_PIXELS
    sketches = [make_sketch(sensor, seed) for seed in (0, 1)]

    def clouds(found: list) -> None:
        reconstructor = Reconstructor(sensor, sketches[0].frequencies, surfaces=2, device="cpu")
        found += [reconstructor(sketch) for sketch in sketches * 3]

    alone, together = [], ([], [])
    clouds(alone)
    threads = [Thread(target=clouds, args=(found,)) for found in together]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for found in together:
        assert len(found) == len(alone)
        assert all(np.array_equal(one.depth_bins, other.depth_bins) for one, other in zip(found, alone, strict=True))


SENSOR = SensorModel(4, 5, 64, 1e-10, np.ones(3))


@pytest.fixture
def missing(monkeypatch):
    """Makes a machine lack something, whatever this one has."""
    def set_to(driver: str = "libc.so.6", absent=(), cuda: str | None = "13.0", gpu: bool = True, gcc: str = "gcc"):
        monkeypatch.setattr(device, "DRIVER", driver)
        monkeypatch.setattr(device, "find_spec", lambda name: None if name in absent else object())
        monkeypatch.setattr(device, "which", lambda name: gcc)
        monkeypatch.setattr(torch.version, "cuda", cuda)
        monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
    return set_to


LACKS = [({"driver": "libnone.so"}, "no CUDA device"),
         ({"gpu": False}, "no CUDA device"),
         ({"absent": ["torch"]}, "torch not installed: pip install '.[gpu]' in the clone"),
         ({"cuda": None}, f"torch {torch.__version__} is built without"),
         ({"absent": ["triton"]}, "triton, which compiles torch's kernels, not installed: pip install triton"),
         ({"gcc": ""}, "no C compiler, which triton needs")]


@pytest.mark.parametrize(("lack", "said"), LACKS)
def test_what_cuda_lacks_is_said_in_one_line_and_auto_computes_on_the_cpu(missing, caplog, lack, said):
    missing(**lack)
    with caplog.at_level(logging.INFO):
        assert Reconstructor(SENSOR, (1, 2)).device == "cpu"
    assert len(caplog.messages) == 1 and re.fullmatch(f"{re.escape(said)}.*: computing on the CPU", caplog.messages[0])
    for make in (kernels_for, lambda name: Reconstructor(SENSOR, (1, 2), device=name)):
        with pytest.raises(InvalidInput, match=f"^device is cuda: expected cpu or auto: {re.escape(said)}[^\n]*$"):
            make("cuda")


def test_cuda_is_the_oracle_in_single_precision(missing):
    missing()
    kernels = kernels_for("cuda")
    assert (kernels.device, kernels.dtype) == ("cuda", torch.float32)
    assert kernels_for("cpu") is kernels_for("auto")


SHAPE = 2, 3, 1, (1, 2)
NAMES = [name for name, each in vars(contract.Kernels).items() if inspect.isfunction(each) and name[0] != "_"]


def arguments(function) -> list[tuple]:
    """Names, kinds and default values of a function's arguments."""
    return [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize("device", [cpu, oracle.on("cpu")], ids=["cpu", "oracle"])
@pytest.mark.parametrize("name", NAMES)
def test_a_backend_has_what_the_contract_names(device, name):
    contracted = getattr(contract.Kernels, name)
    assert contracted.__doc__
    if name != "unpack":        # the numbers of arrays differ
        assert arguments(getattr(device.for_shape(*SHAPE), name)) == arguments(contracted)[1:]


def test_the_contract_names_every_kernel():
    assert set(oracle.FUNCTIONS) <= set(NAMES)
