"""Sketched real-time 3D reconstruction from single-photon lidar, as ROS 2 nodes and a library."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from srt3d_ros.api import *

__version__ = "0.2.0"

__all__ = ["Cloud", "FreeSpaceStream", "InvalidInput", "Photons", "Reconstructor", "Sensor", "Sketch", "from_counts",
           "from_events", "read", "reconstruct"]


def __getattr__(name: str) -> Any:
    """What srt3d_ros.api has, imported when it is first asked for: nodes and commands do not need it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.api"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
