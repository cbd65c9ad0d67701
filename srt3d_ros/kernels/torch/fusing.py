"""`fused`: mark functions that torch compiles for a GPU, each into few kernels."""

import warnings
from collections.abc import Callable
from functools import update_wrapper

import torch
from torch._dynamo import config

# Sums over neighbours read their inputs in place: no array [neighbours × pixels] is stored. One of more than 10 inputs
# is, because fusing it would take minutes to compile. Sums over a pixel's surfaces, at most four, are unrolled; sums
# over frequencies are loops.
OPTIONS = {"realize_reads_threshold": 1000, "realize_opcount_threshold": 1000, "realize_acc_reads_threshold": 10,
           "unroll_reductions_threshold": 5}
MAX_FORMS = 10**6       # of a function, one for each shape and scale; torch's default limit treats many as a mistake
warnings.filterwarnings("ignore", "TensorFloat32 tensor cores")         # exact products are on purpose


class Fused:
    """A function that is compiled for arrays on a GPU, and runs step by step elsewhere."""

    def __init__(self, function: Callable):
        self.function, self._compiled = function, None
        update_wrapper(self, function)

    def compiles(self, array) -> bool:
        """Whether the function is compiled for this array."""
        return array.is_cuda

    def compile(self) -> Callable:
        """The function, compiled for each new combination of shapes and other arguments."""
        return torch.compile(self.function, fullgraph=True, dynamic=False, options=OPTIONS)

    def __call__(self, *arguments, **more):
        if torch.compiler.is_compiling() or not self.compiles(getattr(arguments[0], "matched", arguments[0])):
            return self.function(*arguments, **more)
        if self._compiled is None:
            self._compiled = self.compile()
        with config.patch(recompile_limit=MAX_FORMS, accumulated_recompile_limit=MAX_FORMS):
            return self._compiled(*arguments, **more)


fused = Fused
