"""What made a recording or a measurement: the machine, versions of this package and of what it computes with."""

import os
import platform
import re
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from srt3d_ros import __version__

PACKAGES = {"numpy": "numpy", "scipy": "scipy", "numba": "numba", "torch": "torch", "rerun": "rerun-sdk"}


def versions() -> dict[str, str]:
    """Versions by name, of the packages that are installed."""
    found = {"srt3d_ros": __version__, "python": platform.python_version()}
    for name, package in PACKAGES.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            pass
    return found


def machine() -> dict:
    """Date, processor, number of its cores, load, and versions."""
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return {"date": date.today().isoformat(), "machine": model[1].strip() if model else platform.machine(),
            "cpus": len(os.sched_getaffinity(0)), "load_1min": round(os.getloadavg()[0], 2)} | versions()
