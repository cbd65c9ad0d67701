"""`device: auto`: a GPU that computes otherwise than the CPU, or not faster, is left alone. The oracle acts the GPU."""

import logging
import re

import numpy as np
import pytest

from srt3d_ros import gpu_check
from srt3d_ros.core.method import matched_frame
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.kernels import cpu
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.reconstruction import Reconstructor
from tests.core.scenes import make_sensor, simulate

SENSOR = make_sensor(12, 17)


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
        return chosen.device, chosen.device_reason, caplog.messages
    return take


@pytest.mark.parametrize(("surfaces", "late", "method"), [
    (1, 0, "pooled"), (2, 0, "pooled"), (1, 90, "pooled"), (2, 90, "srt3d")])
def test_a_gpu_that_does_the_same_and_sooner_is_taken(auto, surfaces, late, method):
    sensor = make_sensor(12, 17, delay_bins=late * (SENSOR.rays[..., 0] > 0))
    assert auto(sensor, surfaces=surfaces, method=method) == ("cuda", "5 ms a frame, on the CPU 20", [])


def fail(*arguments, **more):
    raise RuntimeError("CUDA out of memory.\nTried to allocate")


def wrong(frame, state, *others, **more):
    after = oracle.FUNCTIONS["pooled_step"](frame, state, *others, **more)
    after[20, :, 0] += 3
    return after


@pytest.mark.parametrize(("changes", "why"), [
    ({"gpu_ms": 21}, "21 ms a frame instead of 20"), ({"match": fail, "search": fail}, "CUDA out of memory."),
    ({"pooled_step": wrong}, r"\d\d\.\d % of its pixels are as on the CPU")])
def test_one_that_is_slower_fails_or_computes_otherwise_is_not(auto, changes, why):
    device, reason, said = auto(**changes)
    assert device == "cpu" and re.fullmatch(why, reason)
    assert said == [f"the GPU is not used ({reason}): computing on the CPU"]


def test_one_that_fails_later_leaves_its_frames_to_the_cpu(monkeypatch, caplog):
    kernels, frequencies = oracle.on("cpu"), choose_frequencies("auto", SENSOR, 7)
    frame = sketch_photons(simulate(np.full((12, 17), 200.0), 10, 40, SENSOR), SENSOR, frequencies)
    monkeypatch.setattr(matched_frame, "kernels_for", {"cpu": cpu, "cuda": kernels}.get)
    reconstructor = Reconstructor(SENSOR, frame.frequencies, device="cuda", surfaces=2)
    reconstructor(frame)
    monkeypatch.setattr(kernels, "array", fail)
    for failed in (reconstructor, Reconstructor(SENSOR, frame.frequencies, device="cuda"), reconstructor):
        assert len(failed(frame)) > 0.98 * SENSOR.pixels and failed.device == "cpu"
    assert caplog.messages[-2:] == 2 * ["the GPU failed: CUDA out of memory.: computing on the CPU from now on"]
