"""What a GPU needs of the oracle: that no step looks at a value, blocks that fit its memory, and single precision."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from srt3d_ros.core.method.memory import PooledStream
from srt3d_ros.kernels import maps
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.kernels.torch import windows

from .frames import GATE, ORACLE, Backend, make_frame, make_sensor, make_sketch, make_state, make_terms, padded


@pytest.mark.parametrize(("surfaces", "warm"), [(1, True), (2, False)])
def test_no_step_of_a_frame_looks_at_a_value_or_has_a_shape_that_depends_on_one(monkeypatch, spreading, surfaces, warm):
    """On torch's device `meta`, which has shapes but no values, nor any copies to or from the host."""
    spreading(1)        # each further pixel does the same again
    kernels = oracle.on("meta")
    monkeypatch.setattr("srt3d_ros.core.method.memory.kernels_for", lambda device: (device, kernels))
    sensor = make_sensor(9, 33, seed=0)
    sketch = make_sketch(sensor, 0)
    reconstructor = PooledStream(sensor, sketch.frequencies, surfaces, device="cuda", warm_start=warm)
    uneven = sketch.photons.astype(np.float32), np.ones(7, np.complex64), np.ones(sensor.num_bins, np.float32)
    for taken in ((), uneven):
        arrays = map(kernels.array, (sketch.photons.astype(np.float32), sketch.sums, *taken))
        start = kernels.array(np.zeros(maps.state_shape(9, 33, surfaces), np.float32)) if warm else None
        state, left, background, points, number = reconstructor._pooled._estimate(start, *arrays)
        assert {each.device.type for each in (state, left, background, points, number)} == {"meta"}
        assert background.shape == (9, 33) and points.shape == (11, 9 * 33 * surfaces + 1)


@pytest.mark.parametrize("surfaces", [1, 2])
def test_blocks_of_one_row_give_what_all_rows_at_once_give(monkeypatch, surfaces):
    frame = make_frame((9, 33), 1)
    state = make_state(frame, surfaces, 1)
    terms = make_terms(frame, state)

    def results() -> SimpleNamespace:
        wide = padded(frame)
        return SimpleNamespace(
            born=ORACLE.birth_death(wide, state, terms, GATE), match=ORACLE.match(frame, 2)[0],
            pooled=ORACLE.pooled_step(wide, state, terms, 5.0, 8, 4, GATE), terms=ORACLE.expand(wide, state),
            left=ORACLE.residual(wide, state, terms, surfaces - 1))

    at_once = vars(results())
    monkeypatch.setattr(windows, "MEMORY", 1)
    for name, found in vars(results()).items():
        np.testing.assert_allclose(found, at_once[name], rtol=1e-6, atol=1e-6, err_msg=name)


def test_a_block_stays_within_its_memory(monkeypatch):
    """By what its tensors take as they come and go."""
    frame = make_frame((12, 33), 1)
    kernels = oracle.on("cpu", torch.float64)
    for surfaces in (1, 2):
        state = make_state(frame, surfaces, 1)
        wide, state = Backend("", kernels).on(padded(frame)), kernels.array(state)
        terms = kernels.expand(wide, state)
        monkeypatch.setattr(windows, "MEMORY", 2**22)
        for step in (lambda: kernels.birth_death(wide, state, terms, GATE), lambda: kernels.match(wide, 2),
                     lambda: kernels.pooled_step(wide, state, terms, 5.0, 14, 4, GATE)):
            assert peak_bytes(step) < 2**22 + 12 * state.nbytes


def peak_bytes(step) -> int:
    """The most memory that a step's tensors take at any time."""
    with torch.profiler.profile(profile_memory=True) as profile:
        step()
    now = most = 0
    for event in sorted(profile.profiler.kineto_results.events(), key=lambda event: event.start_ns()):
        if event.name() == "[memory]":
            now += event.nbytes()
            most = max(most, now)
    return most


def test_products_of_matrices_are_exact_to_the_type_and_what_the_user_has_set_stays():
    seen = []

    def frame(counts) -> tuple:
        seen.append(torch.get_float32_matmul_precision())
        return counts, torch.zeros(11, 1), torch.zeros(1, dtype=torch.int64)

    torch.set_float32_matmul_precision("medium")
    try:
        oracle.on("cpu").run_frame(frame, np.zeros((1, 1), np.float32))
        assert seen == ["highest"] and torch.get_float32_matmul_precision() == "medium"
    finally:
        torch.set_float32_matmul_precision("highest")
