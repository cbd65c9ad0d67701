"""A frame's memory is made once: after the first frame, kernels write into it and allocate nothing."""

import tracemalloc
from threading import Thread

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from srt3d_ros.core.matched_frame import MatchedFrame, Matcher
from srt3d_ros.kernels import cpu, maps
from srt3d_ros.kernels.cpu.compiling import Kernel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.reconstruction import Reconstructor

from .frames import GATE, make_sensor, make_sketch

SHAPE, SURFACES = (70, 80), 2       # more than SERIAL_PIXELS
SENSOR = make_sensor(*SHAPE, seed=0)
SKETCHES = [make_sketch(SENSOR, seed) for seed in (0, 1)]


@pytest.fixture(scope="module")
def steps() -> tuple:
    """The kernels of a frame by name, with their arguments."""
    matcher, sketch = Matcher(SENSOR, SKETCHES[0].frequencies), SKETCHES[0]
    kernels = cpu.for_shape(*SHAPE, SURFACES, matcher.frequencies)
    inputs = sketch.sums, sketch.photons.astype(np.float32), matcher.equaliser, matcher.used
    frame, _ = matcher.on(kernels).match(inputs[1], inputs[0])
    state = kernels.no_surfaces(frame, SURFACES)
    kernels.search(frame, frame.matched, state, 0, 1.0, 1, 3.0)
    terms = kernels.expand(frame, state)
    assert (state[:, :, maps.INTENSITY] > 0).mean() > 0.1
    arguments = {
        "no_surfaces": (frame, SURFACES), "search": (frame, frame.matched, state, 1, 2.5, 2, 3.0, None, 0.0, True),
        "expand": (frame, state), "log_likelihood_ratio": (frame, state, terms), "residual": (frame, state, terms, 1),
        "birth_death": (frame, state, terms, GATE), "pooled_step": (frame, state, terms, 9.0, 14, 4, GATE),
        "trim": (frame, state, terms, 3.0), "finalise": (frame, inputs[1], state, terms, 3.0)}
    return kernels, arguments


def arrays(values) -> list:
    """The arrays among arguments, and in their fields."""
    values = [Frame.of(each) if isinstance(each, MatchedFrame) else each for each in values]
    return [array for each in values for array in ([each] if isinstance(each, np.ndarray) else
                                                   arrays(each) if isinstance(each, tuple) else [])]


@pytest.mark.parametrize("name", ["search", "expand", "log_likelihood_ratio", "residual", "birth_death", "pooled_step",
                                  "trim", "finalise", "no_surfaces"])
def test_a_kernel_allocates_less_than_a_map_of_points(steps, name, monkeypatch):
    (kernels, arguments), passed = steps, []
    call, run = Kernel.__call__, getattr(kernels, name)
    run(*arguments[name])           # compiled, or read from the disk
    monkeypatch.setattr(Kernel, "__call__", lambda kernel, *given: passed.extend(arrays(given)) or call(kernel, *given))
    _nrt_python.memsys_enable_stats()
    compiled = rtsys.get_allocation_stats().alloc
    tracemalloc.start()
    run(*arguments[name])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    by_compiled_code = rtsys.get_allocation_stats().alloc - compiled
    _nrt_python.memsys_disable_stats()
    assert by_compiled_code <= len(passed)      # an array that is passed counts as one
    assert peak < kernels.work.ratios.nbytes


def test_reconstructors_in_two_threads_do_not_meet():
    def clouds(found: list) -> None:
        reconstructor = Reconstructor(SENSOR, SKETCHES[0].frequencies, surfaces=SURFACES, device="cpu")
        found += [reconstructor(sketch) for sketch in SKETCHES * 3]

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
