"""Both backends keep the contract; which device computes, and what is said where the one asked for is missing."""

import inspect
import logging
import re
import subprocess
import sys

import numpy as np
import pytest
import torch

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels import contract, cpu
from srt3d_ros.kernels import devices as device
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.kernels.devices import kernels_for
from srt3d_ros.reconstruction import Reconstructor

SENSOR = SensorModel(4, 5, 64, 1e-10, np.ones(3))


@pytest.fixture
def missing(monkeypatch):
    """Makes a machine lack something, whatever this one has."""
    def set_to(driver: str = "libc.so.6", absent=(), cuda: str | None = "13.0", gpu: bool = True, gcc: str = "gcc"):
        monkeypatch.setattr(device, "DRIVER", driver)
        monkeypatch.setattr(device, "find_spec", lambda name: None if name in absent else object())
        monkeypatch.setattr(device, "which", lambda name: gcc)
        monkeypatch.setattr(torch.version, "cuda", cuda)
        monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)
    return set_to


LACKS = [({"driver": "libnone.so"}, "no CUDA device"),
         ({"gpu": False}, "no CUDA device"),
         ({"absent": ["torch"]}, "torch not installed: pip install '.[gpu]' in the clone"),
         ({"cuda": None}, f"torch {torch.__version__} is built without"),
         ({"absent": ["triton"]}, "triton, which compiles torch's kernels, not installed: pip install triton"),
         ({"gcc": ""}, "no C compiler, which triton needs")]


@pytest.mark.parametrize(("lack", "said"), LACKS)
def test_what_cuda_lacks_is_said_in_one_line_and_auto_computes_on_the_cpu(missing, caplog, lack, said):
    missing(**lack)
    with caplog.at_level(logging.INFO):
        assert Reconstructor(SENSOR, (1, 2)).device == "cpu"
    assert len(caplog.messages) == 1 and re.fullmatch(f"{re.escape(said)}.*: computing on the CPU", caplog.messages[0])
    for make in (kernels_for, lambda name: Reconstructor(SENSOR, (1, 2), device=name)):
        with pytest.raises(InvalidInput, match=f"^device is cuda: expected cpu or auto: {re.escape(said)}[^\n]*$"):
            make("cuda")


def test_cuda_is_the_oracle_in_single_precision(missing):
    missing()
    kernels = kernels_for("cuda")
    assert (kernels.device, kernels.dtype) == ("cuda", torch.float32)
    assert kernels_for("cpu") is kernels_for("auto")


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


def test_the_contract_names_every_kernel_and_what_both_share_needs_numpy_alone():
    assert set(oracle.FUNCTIONS) <= set(NAMES)
    names = "{'numba', 'torch', 'srt3d_ros.core', 'srt3d_ros.errors'}"
    modules = "import sys; from srt3d_ros.kernels import constants, contract, lens, maps"
    program = f"{modules}; sys.exit(str({names} & set(sys.modules) or ''))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stderr.strip() == ""
