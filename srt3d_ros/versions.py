"""What made a recording or a measurement: the machine, versions of this package and of what it computes with."""

import os
import platform
import re
import subprocess
from datetime import date
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path

from srt3d_ros import __version__

_PACKAGES = {"numpy": "numpy", "torch": "torch", "numba": "numba", "rerun": "rerun-sdk"}
MEASURED_WITH = ("numpy", "scipy", "numba", "torch")
_ROOT = Path(__file__).resolve().parents[1]
_GIT_TIMEOUT_S = 5.0
UNKNOWN = "unknown"
ABSENT = "not installed"


def versions() -> dict[str, str]:
    """Versions by name; "unknown" for what cannot be found out, "not installed" for packages that are not."""
    return {"srt3d_ros": __version__, "git_revision": _git_revision(), "python": platform.python_version(),
            **{name: installed(package) or ABSENT for name, package in _PACKAGES.items()},
            "ros_distro": _ros_distro()}


def machine(device: str = "cpu") -> dict:
    """Date, processor, load, GPU if `device` is "cuda", and versions of the packages that compute (None: missing)."""
    return {"date": date.today().isoformat(), "machine": _processor(), "cpus": len(os.sched_getaffinity(0)),
            **({"gpu": _gpu()} if device == "cuda" else {}),
            "load_1min": round(os.getloadavg()[0], 2), "python": platform.python_version(), "srt3d_ros": __version__,
            **{name: installed(name) for name in MEASURED_WITH}}


def installed(package: str) -> str | None:
    """The version of a package; None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found[1].strip() if found else platform.machine()


def _gpu() -> str:
    import torch
    return torch.cuda.get_device_name()


def _git_revision() -> str:
    """The first 12 digits of the revision that is checked out here, and "+changes" if files were changed.

    "unknown" unless the package lies in the top of the checkout: one installed somewhere into it does not count.
    """
    try:
        top, revision = _git("rev-parse", "--show-toplevel", "HEAD").split("\n")
        if Path(top).resolve() != _ROOT:
            return UNKNOWN
        return revision[:12] + ("+changes" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError, ValueError):
        return UNKNOWN


def _git(*arguments: str) -> str:
    return subprocess.run(["git", "-C", _ROOT, *arguments], capture_output=True, text=True, check=True,
                          timeout=_GIT_TIMEOUT_S).stdout.strip()


def _ros_distro() -> str:
    """The sourced ROS 2 distribution, or the one whose wheels are installed."""
    if "ROS_DISTRO" in os.environ:
        return os.environ["ROS_DISTRO"]
    names = (distribution.metadata["Name"] or "" for distribution in distributions())
    return next((match[1] for name in names if (match := re.fullmatch("ros-([a-z]+)-rclpy", name))), UNKNOWN)
