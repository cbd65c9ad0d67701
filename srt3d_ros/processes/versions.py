"""Versions of this package and of the packages that it computes with."""

import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from srt3d_ros import __version__

PACKAGES = {"numpy": "numpy", "scipy": "scipy", "numba": "numba", "torch": "torch", "rerun": "rerun-sdk"}


def versions() -> dict[str, str]:
    """Versions of the installed packages, by name."""
    found = {"srt3d_ros": __version__, "python": platform.python_version()}
    for name, package in PACKAGES.items():
        with suppress(PackageNotFoundError):
            found[name] = version(package)
    return found
