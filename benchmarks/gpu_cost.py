"""Kernel launches and bytes of a frame on a GPU, counted without a GPU, and the time that they predict.

`torch.compile` generates the code of each step for a pretended H100, with fake tensors, once for each form in which a
frame calls the step. Each buffer that a kernel reads or writes counts once, as if caches held it. An operation outside
the steps counts as one launch. The predicted time is the bytes at 70 % of the GPU's bandwidth, plus 2 µs per launch (in
a CUDA graph). `make gpu-cost` installs what this needs.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterable, Iterator

import numpy as np
import torch
from torch._subclasses.fake_tensor import FakeTensorMode
from torch.utils import _pytree as trees
from torch.utils._python_dispatch import TorchDispatchMode
from tqdm import tqdm

from benchmarks.fake_gpu import Cost, cost, pretend
from benchmarks.frames import PAPER_MS, sensor_of
from srt3d_ros.core import matched_frame
from srt3d_ros.core.matched_frame import MatchedFrame
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.kernels.torch import FUNCTIONS
from srt3d_ros.kernels.torch.device import Kernels
from srt3d_ros.kernels.torch.fusing import Fused

BANDWIDTH = {"H100": 3.0e12, "RTX 3070 laptop": 448e9, "Jetson Orin": 205e9}        # bytes/s, data sheets
REACHED, LAUNCH_S = 0.7, 2e-6
OUTSIDE = "outside"
VIEWS = ("view", "expand", "slice", "select", "unsqueeze", "squeeze", "permute", "transpose", "as_strided", "detach",
         "alias", "unbind", "split", "unfold", "_unsafe_view", "narrow", "empty", "lift_fresh")


class FakeKernels(Kernels):
    """Kernels that work on fake arrays, which have shapes and no values."""

    def __init__(self, mode: FakeTensorMode):
        super().__init__(FUNCTIONS, "cuda", torch.float32)
        self._mode = mode

    def array(self, values):
        pair = (2,) if np.iscomplexobj(values) else ()
        with self._mode:
            return torch.empty((*values.shape, *pair), device="cuda")

    def as_frame(self, function):
        return lambda *inputs: function(*(each if each is None else self.array(each) for each in inputs))


class Frame(TorchDispatchMode):
    """Counts the cost of a frame while it runs: of its fused functions by name, and of all operations outside them.

    Args:
        lowered: costs of the functions that have been compiled already, by name and form; filled.
    """

    def __init__(self, lowered: dict, bar: tqdm):
        super().__init__()
        self.costs: dict[str, list[Cost]] = defaultdict(list)
        self._lowered, self._bar, self._is_inside = lowered, bar, False

    def __enter__(self):
        self._call, frame = Fused.__call__, self
        Fused.__call__ = lambda function, *given, **more: frame.fused(function, given, more)
        return super().__enter__()

    def __exit__(self, *reason):
        Fused.__call__ = self._call
        return super().__exit__(*reason)

    def fused(self, function: Fused, given: tuple, more: dict):
        """Count a call of a fused function, and run the function for the shapes of its results."""
        if self._is_inside:
            return function.function(*given, **more)
        self._is_inside = True
        try:
            flat, shape = trees.tree_flatten((given, more))
            is_array = [isinstance(each, torch.Tensor) for each in flat]
            form = function.__name__, tuple((tuple(each.shape), each.dtype) if array else each
                                            for each, array in zip(flat, is_array))
            if form not in self._lowered:
                def call(*tensors):
                    arrays = iter(tensors)
                    given, more = trees.tree_unflatten(
                        [next(arrays) if array else each for each, array in zip(flat, is_array)], shape)
                    arguments = trees.tree_leaves(function.function(*given, **more))
                    return [each for each in arguments if isinstance(each, torch.Tensor)]

                self._bar.set_description_str(f"lowering {function.__name__}")
                self._lowered[form] = cost(call, [each for each, array in zip(flat, is_array) if array])
                self._bar.update()
            self.costs[function.__name__].append(self._lowered[form])
            return function.function(*given, **more)
        finally:
            self._is_inside = False

    def __torch_dispatch__(self, operation, types, given=(), more=None):
        found = operation(*given, **(more or {}))
        if not self._is_inside and not str(operation).removeprefix("aten.").startswith(VIEWS):
            arrays = [each for each in trees.tree_leaves((given, more, found)) if isinstance(each, torch.Tensor)]
            self.costs[OUTSIDE].append(Cost(1, 0, sum(each.numel() * each.element_size() for each in arrays), 0))
        return found


def steps_of(name: str, side: int, m: int, surfaces: int, bar: tqdm) -> dict[str, list[Cost]]:
    """The cost of each call in a frame, by the name of the step."""
    sensor, mode = sensor_of(side), FakeTensorMode()
    kernels, frequencies = FakeKernels(mode), choose_frequencies(METHODS[name].frequencies, sensor, m)
    matched_frame.kernels_for = lambda device: kernels
    inputs = [np.empty((side, side), np.float32), np.empty((side, side, m), np.complex64)]
    with mode:
        method = METHODS[name].build(sensor, frequencies, surfaces=surfaces, device="cuda")
        if name == "pooled":
            inputs += [None, np.array(method._scores, np.float32)]
        with Frame({}, bar) as frame:
            (method._frames.run if name == "pooled" else method.run)(*inputs)
    return frame.costs


def total(costs: Iterable[Cost]) -> Cost:
    return Cost(*map(sum, zip(*costs)))


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sides", type=int, nargs="+", default=[142, 705], help="image sizes (%(default)s)")
    parser.add_argument("--m", type=int, nargs="+", default=[10], help="sketch sizes (%(default)s)")
    parser.add_argument("--surfaces", type=int, nargs="+", default=[1], help="K (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each method, size, m and K."""
    pretend()
    Fused.compiles = lambda *_: False
    trees.register_dataclass(MatchedFrame)
    for side, m, surfaces in ((side, m, k) for side in args.sides for m in args.m for k in args.surfaces):
        for name in ("pooled", "srt3d"):
            with tqdm(disable=None, leave=False, bar_format="{n} {desc}") as bar:
                calls = steps_of(name, side, m, surfaces, bar)
            steps = {step: total(costs) for step, costs in calls.items()}
            frame = total(steps.values())
            bar.write("\n".join(
                f"  {step:<22}{len(calls[step]):>5} calls{each.launches:>7} launches{each.bytes / 1e9:>9.3f} GB"
                for step, each in sorted(steps.items(), key=lambda item: -item[1].bytes)))
            times = {gpu: 1e3 * (LAUNCH_S * frame.launches + frame.bytes / REACHED / rate)
                     for gpu, rate in BANDWIDTH.items()}
            yield {"method": name, "pixels": f"{side}x{side}", "m": m, "surfaces": surfaces,
                   "launches": frame.launches, "gigabytes": round(frame.bytes / 1e9, 3),
                   "products_gflop": round(frame.flops / 1e9, 2), "paper_ms": PAPER_MS.get((side - side % 141, m)),
                   "predicted_ms": {gpu: round(time, 2) for gpu, time in times.items()}}
