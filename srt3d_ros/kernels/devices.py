"""Selects the kernels of a device by its name."""

import ctypes
import os
from importlib import import_module
from importlib.util import find_spec
from shutil import which
from typing import Any

from srt3d_ros.errors import InvalidInput, require

DEVICES = ("auto", "cpu", "cuda")
DRIVER = "libcuda.so.1"


def kernels_for(device: str) -> Any:
    """A `contract.Device`; InvalidInput if something for it is missing. "auto" is the CPU here, which sketches, too."""
    require(device in DEVICES, "device", device, "auto, cpu or cuda")
    _wait_briefly()
    if device != "cuda":
        return import_module("srt3d_ros.kernels.cpu")
    if missing := missing_for_cuda():
        raise InvalidInput("device", "cuda", f"cpu or auto: {missing}")
    return import_module("srt3d_ros.kernels.torch").on("cuda")


def compile_kernels(*modules: str) -> None:
    """Compile the CPU's kernels in these modules, or read them from the disk, unless that has been done."""
    for name, kernel in kernels_for("cpu").KERNELS.items():
        if name.partition(".")[0] in modules:
            kernel.compile()


def missing_for_cuda() -> str:
    """What is missing to compute on a GPU; "" if nothing is."""
    _wait_briefly()
    try:
        ctypes.CDLL(DRIVER)     # first: importing torch takes long
    except OSError:
        return "no CUDA device"
    if not find_spec("torch"):
        return "torch not installed: pip install '.[gpu]' in the clone"
    import torch
    if torch.version.cuda is None:
        return f"torch {torch.__version__} is built without CUDA"
    if not torch.cuda.is_available():
        return "no CUDA device"
    if not find_spec("triton"):
        return "triton, which compiles torch's kernels, not installed: pip install triton"
    return "" if any(map(which, (os.environ.get("CC") or "gcc", "clang"))) else "no C compiler, which triton needs: gcc"


def _wait_briefly() -> None:
    """Let OpenMP's threads sleep soon; it reads this when it is loaded, after this call.

    By default they spin for milliseconds while they wait for their next kernel, on cores that other nodes need.
    Sleeping at once is not right either: to be woken for each of a frame's 70 kernels takes half as long as the work
    itself. So they spin for about as long as it takes to wake them: 1000 turns of GNU's OpenMP, which numba uses on
    Linux. A frame of 141 × 141 pixels on two cores then takes 15 ms on an idle machine, and 33 beside a process that
    takes a core; 22 and 27 ms if they slept at once; 15 and 60 with ten times the turns.
    """
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ["OMP_WAIT_POLICY"] = "passive"
        os.environ.setdefault("GOMP_SPINCOUNT", "1000")
