"""The CPU has the names and arguments of the oracle, and what both share needs nothing of what they need."""

import inspect
import subprocess
import sys

import pytest

from srt3d_ros.kernels import cpu
from srt3d_ros.kernels import torch as oracle

SHAPE = 2, 3, 1, (1, 2)
OURS, THEIRS = cpu.for_shape(*SHAPE), oracle.on("cpu").for_shape(*SHAPE)


def arguments(function) -> list[tuple]:
    """Names, kinds and default values of a function's arguments."""
    return [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize("name", [*oracle.FUNCTIONS, "array", "as_frame", "numpy"])
def test_the_cpu_has_the_names_and_arguments_of_the_oracle(name):
    ours, theirs = getattr(OURS, name), getattr(THEIRS, name)
    assert theirs.__doc__
    assert arguments(ours) == arguments(theirs)


def test_what_both_share_needs_numpy_alone():
    names = "{'numba', 'torch', 'srt3d_ros.core', 'srt3d_ros.errors'}"
    modules = "import sys; from srt3d_ros.kernels import constants, lens, maps"
    program = f"{modules}; sys.exit(str({names} & set(sys.modules) or ''))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stderr.strip() == ""
