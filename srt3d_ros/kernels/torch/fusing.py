"""What a GPU runs as few kernels: `fused` marks the functions that are compiled, each as one graph."""

import warnings
from collections.abc import Callable
from functools import partial, update_wrapper

import torch
from torch._dynamo import config

# Sums over neighbours read what they need where they need it: nothing of [neighbours × pixels] is stored, unless more
# than 10 arrays go into it, as compiling would take minutes. Those over a pixel's surfaces, of which there are at most
# four, are written out; those over frequencies are loops.
OPTIONS = {"realize_reads_threshold": 1000, "realize_opcount_threshold": 1000, "realize_acc_reads_threshold": 10,
           "unroll_reductions_threshold": 5}
MOST_FORMS = 10**6      # that a function is compiled in, one for each shape and scale: torch takes more for a mistake
warnings.filterwarnings("ignore", "TensorFloat32 tensor cores")         # products are exact to the type on purpose


class Fused:
    """A function that is compiled where its arrays are on a GPU, and elsewhere runs step by step."""

    def __init__(self, function: Callable):
        self.function, self._compiled = function, None
        update_wrapper(self, function.func if isinstance(function, partial) else function)

    def compiles(self, array) -> bool:
        """Whether an array asks for it."""
        return array.is_cuda

    def compile(self, **options) -> Callable:
        """The function, compiled for each new combination of shapes and of what is no array."""
        return torch.compile(self.function, fullgraph=True, dynamic=False, options=OPTIONS | options)

    def __call__(self, *arguments, **more):
        if torch.compiler.is_compiling() or not self.compiles(getattr(arguments[0], "matched", arguments[0])):
            return self.function(*arguments, **more)
        if self._compiled is None:
            self._compiled = self.compile()
        with config.patch(recompile_limit=MOST_FORMS, accumulated_recompile_limit=MOST_FORMS):
            return self._compiled(*arguments, **more)


fused = Fused
