"""The machine and versions of a measurement."""

import os
import platform
from datetime import date
from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.recording.versions import installed

PACKAGES = ("numpy", "scipy", "numba", "torch", "triton")


def machine(device: str = "cpu") -> dict:
    """Date, processor, load, GPU if `device` is "cuda", and versions of the packages that compute (None: missing)."""
    return {"date": date.today().isoformat(), "machine": cpu_name(), "cpus": len(os.sched_getaffinity(0)),
            **({"gpu": gpu_name()} if device == "cuda" else {}),
            "load_1min": round(os.getloadavg()[0], 2), "python": platform.python_version(), "srt3d_ros": __version__,
            **{name: installed(name) for name in PACKAGES}}


def cpu_name() -> str:
    """The processor's name."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def gpu_name() -> str:
    """The name of the GPU that torch computes on."""
    import torch
    return torch.cuda.get_device_name()
