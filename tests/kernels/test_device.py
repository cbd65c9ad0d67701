"""What a GPU needs of the kernels, as far as a machine without one can tell: one graph a frame, on one device."""

import gc
import shutil
from collections import defaultdict

import numpy as np
import pytest
import torch

from srt3d_ros.core.methods import METHODS
from srt3d_ros.kernels import maps
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.kernels.torch.device import exact_products
from srt3d_ros.kernels.torch.fusing import Fused

from .frames import assert_clouds_agree, make_sensor, make_sketch

SHAPE = 9, 33
SENSOR = make_sensor(*SHAPE, seed=0)
SKETCHES = [make_sketch(SENSOR, seed) for seed in (0, 1)]
QUICK = "expand", "log_likelihood_ratio", "finalise"       # to compile: seconds each


def built(monkeypatch, kernels, method: str, surfaces: int, **options):
    """A reconstruction that computes with these kernels as if they were a GPU's."""
    monkeypatch.setattr("srt3d_ros.core.baselines.plug_and_play.ITERATIONS", 2)     # the others do the same again
    monkeypatch.setattr("srt3d_ros.core.method.matched_frame.kernels_for", lambda device: kernels)
    return METHODS[method].build(SENSOR, SKETCHES[0].frequencies, surfaces=surfaces, device="cuda", **options)


@pytest.fixture
def compiling(monkeypatch):
    """Has the functions that `which` names compiled, until the end of the test."""
    def begin(which, compile=Fused.compile) -> None:
        monkeypatch.setattr(Fused, "compiles", lambda function, array: which(function.__name__))
        monkeypatch.setattr(Fused, "compile", compile)
        forget()

    def forget() -> None:
        for each in gc.get_objects():
            if type(each) is Fused:
                each._compiled = None

    yield begin
    forget()


def keeping(keep):
    """`Fused.compile` without a compiler: `keep` gets each function, its graph and its inputs."""
    def compile(function):
        def run(graph, inputs):
            keep(function, graph, inputs)
            return graph.forward
        return torch.compile(function.function, fullgraph=True, dynamic=False, backend=run)
    return compile


@pytest.mark.parametrize(("surfaces", "uneven", "exposed"), [
    (1, False, False), (1, True, False), (2, False, False), (2, True, False), (1, True, True)])
def test_no_step_of_a_frame_looks_at_a_value_or_has_a_shape_that_depends_on_one(
        monkeypatch, spreading, surfaces, uneven, exposed):
    """On torch's device `meta`, which has shapes but no values, nor any copies to or from the host."""
    spreading(1)        # each further pixel does the same again
    kernels, sketch = oracle.on("meta"), SKETCHES[0]
    pooled, photons = built(monkeypatch, kernels, "pooled", surfaces), sketch.photons.astype(np.float32)
    background = (photons, np.ones(7, np.complex64), np.ones(SENSOR.num_bins, np.float32)) if uneven else ()
    exposure = maps.pad(np.full(SHAPE, 3, np.float32)) if exposed else None         # of a window
    found = pooled._frames.run(photons, sketch.sums, exposure, np.array(pooled._scores, np.float32), *background)
    assert {each.device.type for each in found} == {"meta"}
    _, rest, background, values, xyz, number = found
    most = 9 * 33 * surfaces + 1
    assert rest.shape == background.shape == SHAPE
    assert (values.shape, xyz.shape, number.shape) == ((6, most), (most, 3), (1,))


@pytest.mark.parametrize("method", ["pooled", "srt3d"])
def test_two_frames_compile_each_step_once_as_one_graph_that_needs_nothing_of_the_host(monkeypatch, compiling, method):
    reconstructor, graphs = built(monkeypatch, oracle.on("cpu"), method, 1), defaultdict(list)
    compiling(lambda name: True, keeping(lambda function, graph, _: graphs[function.__name__].append(graph)))
    first = reconstructor(SKETCHES[0])
    compiled = {name: len(each) for name, each in graphs.items()}
    assert set(compiled) >= {
        "pooled": {"_search_flat", "_pool_down", "_search_across", "_take_planes", "_round", "_step", "finalise",
                   "collect"},
        "srt3d": {"match", "pixelwise", "_joined", "_projected", "_moved"}}[method]
    assert len(reconstructor(SKETCHES[1])) != len(first)
    assert {name: len(each) for name, each in graphs.items()} == compiled
    for graph in sum(graphs.values(), []):
        assert not [node for node in graph.graph.nodes if node.op == "get_attr"]            # tensors of the host's
        for node in graph.graph.nodes:
            if node.target in (torch.arange, torch.zeros, torch.ones, torch.full, torch.tensor, torch.as_tensor):
                assert "device" in node.kwargs, node.format_node()


def test_a_function_is_compiled_for_more_shapes_than_torch_takes_for_a_mistake(compiling):
    shapes = []
    compiling(lambda name: True, keeping(lambda function, graph, inputs: shapes.append(inputs[0].shape)))
    double = Fused(lambda values: values * 2)
    for size in range(2, 14):
        assert torch.equal(double(torch.ones(size)), torch.full((size,), 2.0))
    assert len(shapes) == 12 > torch._dynamo.config.recompile_limit


@pytest.mark.skipif(not shutil.which("g++"), reason="torch compiles for a CPU by g++")
def test_what_is_compiled_gives_the_points_of_what_runs_step_by_step(monkeypatch, compiling):
    """The functions that compile in seconds; all of them do it in minutes."""
    reconstructor, found = built(monkeypatch, oracle.on("cpu"), "pooled", 1), []
    for names in ((), QUICK):
        compiling(lambda name: name in names)
        reconstructor.forget()
        found.append(reconstructor(SKETCHES[0]))
    assert_clouds_agree(*found, surfaces=1, points=250)
    assert not np.array_equal(*(cloud.intensity for cloud in found))        # sums in another order: it was compiled


def test_products_of_matrices_are_exact_to_the_type_and_what_the_user_has_set_stays():
    torch.set_float32_matmul_precision("medium")
    try:
        with exact_products():
            assert torch.backends.cuda.matmul.fp32_precision == "ieee"
        assert torch.backends.cuda.matmul.fp32_precision == "tf32"
        assert torch.get_float32_matmul_precision() == "medium"
    finally:
        torch.set_float32_matmul_precision("highest")
