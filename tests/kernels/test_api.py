"""Both backends have the names and arguments of the contract, and what they share needs nothing of what they need."""

import inspect
import subprocess
import sys

import pytest

from srt3d_ros.kernels import contract, cpu
from srt3d_ros.kernels import torch as oracle

SHAPE = 2, 3, 1, (1, 2)
NAMES = [name for name, each in vars(contract.Kernels).items() if inspect.isfunction(each) and name[0] != "_"]


def arguments(function) -> list[tuple]:
    """Names, kinds and default values of a function's arguments."""
    return [(each.name, each.kind, each.default) for each in inspect.signature(function).parameters.values()]


@pytest.mark.parametrize("device", [cpu, oracle.on("cpu")], ids=["cpu", "oracle"])
@pytest.mark.parametrize("name", NAMES)
def test_a_backend_has_what_the_contract_names(device, name):
    contracted = getattr(contract.Kernels, name)
    assert contracted.__doc__
    if name != "unpack":        # the numbers of arrays differ
        assert arguments(getattr(device.for_shape(*SHAPE), name)) == arguments(contracted)[1:]


def test_the_contract_names_every_kernel():
    assert set(oracle.FUNCTIONS) <= set(NAMES)


def test_what_both_share_needs_numpy_alone():
    names = "{'numba', 'torch', 'srt3d_ros.core', 'srt3d_ros.errors'}"
    modules = "import sys; from srt3d_ros.kernels import constants, contract, lens, maps"
    program = f"{modules}; sys.exit(str({names} & set(sys.modules) or ''))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stderr.strip() == ""
