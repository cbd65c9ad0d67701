"""`device: auto`: a GPU that computes otherwise than the CPU, or not faster, is left alone. The oracle acts the GPU."""

import logging
import re

import pytest

from srt3d_ros import gpu_check
from srt3d_ros.core import matched_frame
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.kernels import cpu
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.reconstruction import Reconstructor
from tests.core.scenes import make_sensor

SENSOR = make_sensor(12, 17)


def kernels_of(method):
    return method._frames.kernels if isinstance(method, Pooled) else method.kernels


@pytest.fixture
def auto(monkeypatch, caplog):
    """The device that `auto` takes, and what the log says, where this many milliseconds pass for each frame."""
    def take(sensor: SensorModel = SENSOR, gpu_ms: float = 5.0, surfaces=1, method="pooled", **changes) -> tuple:
        kernels, now = oracle.on("cpu"), iter([0.0, 0.02, 1.0, 1 + gpu_ms / 1e3])
        for name, value in changes.items():
            monkeypatch.setattr(kernels, name, value)
        monkeypatch.setattr(gpu_check, "missing_for_cuda", lambda: "")
        monkeypatch.setattr(gpu_check.time, "perf_counter", lambda: next(now))
        monkeypatch.setattr(matched_frame, "kernels_for", {"cpu": cpu, "cuda": kernels}.get)
        with caplog.at_level(logging.INFO):
            chosen = Reconstructor(sensor, choose_frequencies("auto", sensor, 7), method=method, surfaces=surfaces)
        return chosen.device, kernels_of(chosen._method) is kernels, chosen.device_reason, caplog.messages
    return take


@pytest.mark.parametrize(("surfaces", "late", "method"), [
    (1, 0, "pooled"), (2, 0, "pooled"), (1, 90, "pooled"), (2, 90, "srt3d")])
def test_a_gpu_that_does_the_same_and_sooner_is_taken(auto, surfaces, late, method):
    sensor = make_sensor(12, 17, delay_bins=late * (SENSOR.rays[..., 0] > 0))
    assert auto(sensor, surfaces=surfaces, method=method) == ("cuda", True, "5 ms a frame, on the CPU 20", [])


def test_one_that_is_slower_is_not(auto):
    assert auto(gpu_ms=21) == ("cpu", False, "21 ms a frame instead of 20", [
        "the GPU is not used (21 ms a frame instead of 20): computing on the CPU"])


def test_one_that_fails_is_not(auto):
    def fail(*arguments, **more):
        raise RuntimeError("CUDA out of memory.\nTried to allocate")

    assert auto(match=fail, search=fail) == ("cpu", False, "CUDA out of memory.", [
        "the GPU is not used (CUDA out of memory.): computing on the CPU"])


def test_one_that_computes_otherwise_is_not(auto):
    def wrong(frame, state, *others, **more):
        after = oracle.FUNCTIONS["pooled_step"](frame, state, *others, **more)
        after[20, :, 0] += 3
        return after

    *taken, _, said = auto(pooled_step=wrong)
    assert taken == ["cpu", False] and len(said) == 1
    expected = r"the GPU is not used \(\d\d\.\d % of its pixels are as on the CPU\): computing on the CPU"
    assert re.fullmatch(expected, said[0])


def test_one_that_fails_later_leaves_its_frames_to_the_cpu(monkeypatch, caplog):
    kernels, frame = oracle.on("cpu"), gpu_check._frame(SENSOR, choose_frequencies("auto", SENSOR, 7))
    monkeypatch.setattr(matched_frame, "kernels_for", {"cpu": cpu, "cuda": kernels}.get)
    reconstructor = Reconstructor(SENSOR, frame.frequencies, device="cuda", surfaces=2)
    reconstructor(frame)

    def fail(*arguments):
        raise RuntimeError("CUDA error: unspecified launch failure\nCompile with")

    monkeypatch.setattr(reconstructor._method._frames, "run", fail)
    monkeypatch.setattr(kernels, "array", fail)
    for failed in (reconstructor, Reconstructor(SENSOR, frame.frequencies, device="cuda"), reconstructor):
        assert len(failed(frame)) > 0.98 * SENSOR.pixels and failed.device == "cpu"
    assert caplog.messages[-2:] == 2 * ["the GPU failed: CUDA error: unspecified launch failure: "
                                        "computing on the CPU from now on"]


def test_the_frame_that_is_tried_shows_its_walls():
    frame = gpu_check._frame(SENSOR, choose_frequencies("auto", SENSOR, 7))
    cloud = Pooled(SENSOR, frame.frequencies, device="cpu")(frame)
    assert len(cloud) > 0.98 * SENSOR.pixels and gpu_check.share_alike(cloud, cloud, SENSOR.num_bins) == 1
