"""Selects the kernels by the name of a device; no other module knows which backends there are."""

import ctypes
import logging
import os
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

import numpy as np

from srt3d_ros.errors import InvalidInput, require

DEVICES = ("auto", "cpu", "cuda")
DRIVER = "libcuda.so.1"


def kernels_for(device: str) -> tuple[str, ModuleType]:
    """The device, "cpu" or "cuda", and its kernels; where "auto" finds no GPU, Python's log says so once.

    Raises:
        InvalidInput: there is no such device, or what it needs is not installed.
    """
    require(device in DEVICES, "device", device, "auto, cpu or cuda")
    if device == "auto":
        missing = _missing_for_cuda()
        if missing:
            _say(f"{missing}: computing on the CPU")
        device = "cpu" if missing else "cuda"
    if device == "cuda":
        _check_cuda()
    return device, import_module(f"srt3d_ros.kernels.{device}")


def on_device(fields: dict, kernels: ModuleType) -> dict:
    """The same fields, NumPy arrays among them on the kernels' device."""
    return {name: kernels.array(value) if isinstance(value, np.ndarray) else value for name, value in fields.items()}


def _check_cuda() -> None:
    """Raise InvalidInput unless the CUDA kernels can run: on a GPU or, with TRITON_INTERPRET=1, interpreted."""
    packages = _missing_packages()
    interpreted = os.environ.get("TRITON_INTERPRET") == "1" and not packages
    missing = "" if interpreted else _missing_for_cuda()
    if missing:
        both = missing if packages in missing else f"{missing}, and {packages}"
        raise InvalidInput("device", "cuda", f"cpu or auto: {both}")


def _missing_for_cuda() -> str:
    """The first thing that the CUDA kernels lack to run on a GPU; empty if nothing."""
    try:
        ctypes.CDLL(DRIVER)     # before torch, whose import takes long
    except OSError:
        return "no CUDA device"
    if packages := _missing_packages():
        return packages
    import torch
    if torch.version.cuda is None:
        return f"torch {torch.__version__} is built without CUDA"
    return "" if torch.cuda.is_available() else "no CUDA device"


def _missing_packages() -> str:
    """Which packages of the extra `gpu` are not installed, and how to get them; empty if none is missing."""
    names = [name for name in ("torch", "triton") if find_spec(name) is None]
    return f"{' and '.join(names)} not installed: pip install 'srt3d_ros[gpu]'" if names else ""


@lru_cache
def _say(text: str) -> None:
    logging.getLogger(__name__).info(text)
