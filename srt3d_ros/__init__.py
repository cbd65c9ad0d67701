"""Sketched real-time 3D reconstruction from single-photon lidar, as ROS 2 nodes and a library."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from srt3d_ros.api import *

# OpenMP's threads spin for milliseconds, by default, while they wait for their next kernel, on cores that other nodes
# need. Sleeping at once is not right either: to be woken for each of a frame's 70 kernels takes half as long as the
# work itself. So they spin for about as long as it takes to wake them, then sleep: 1000 turns of GNU's OpenMP, which
# numba uses on Linux. A frame of 141 × 141 pixels on two cores then takes 15 ms on an idle machine, and 33 beside a
# process that takes a core; 22 and 27 ms if they slept at once; 15 and 60 with ten times the turns. Read when OpenMP is
# loaded.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ["OMP_WAIT_POLICY"] = "passive"
    os.environ.setdefault("GOMP_SPINCOUNT", "1000")

__version__ = "0.2.0"

__all__ = ["Cloud", "InvalidInput", "Photons", "Reconstructor", "Sensor", "Sketch", "from_counts", "from_events",
           "read", "reconstruct"]


def __getattr__(name: str) -> Any:
    """What srt3d_ros.api has, imported when it is first asked for: nodes and commands do not need it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.api"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
