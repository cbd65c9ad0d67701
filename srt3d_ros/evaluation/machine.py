"""Where and with what something was measured."""

import os
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path


def machine() -> dict:
    """Date, processor, its load, and the versions of what computes."""
    return {"date": date.today().isoformat(), "machine": cpu_name(), "cpus": len(os.sched_getaffinity(0)),
            "load_1min": round(os.getloadavg()[0], 2), "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "torch", "numba")}}


def cpu_name() -> str:
    """The processor's name."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()
