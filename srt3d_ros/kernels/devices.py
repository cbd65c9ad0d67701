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
    if device != "cuda":
        return import_module("srt3d_ros.kernels.cpu")
    if missing := missing_for_cuda():
        raise InvalidInput("device", "cuda", f"cpu or auto: {missing}")
    return import_module("srt3d_ros.kernels.torch").on("cuda")


def missing_for_cuda() -> str:
    """What is missing to compute on a GPU; "" if nothing is."""
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
