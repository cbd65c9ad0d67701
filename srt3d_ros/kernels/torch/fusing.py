"""What a GPU runs as few kernels: `fused` marks the functions that are compiled, each as one graph."""

from collections.abc import Callable
from functools import update_wrapper

import torch

# Sums over neighbours read what they need where they need it: nothing of [neighbours × pixels] is stored.
OPTIONS = {"realize_reads_threshold": 1000, "realize_opcount_threshold": 1000}


class Fused:
    """A function that is compiled where its arrays are on a GPU, and elsewhere runs step by step."""

    compiles = staticmethod(lambda array: array.is_cuda)        # whether the arrays of a call ask for it

    def __init__(self, function: Callable):
        self.function, self._compiled = function, None
        update_wrapper(self, function)

    def __call__(self, *arguments, **more):
        if torch.compiler.is_compiling() or not self.compiles(getattr(arguments[0], "matched", arguments[0])):
            return self.function(*arguments, **more)
        if self._compiled is None:
            self._compiled = torch.compile(self.function, fullgraph=True, dynamic=False, options=OPTIONS)
        return self._compiled(*arguments, **more)


fused = Fused
