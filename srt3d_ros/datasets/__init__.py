"""Photon files, published data, bags and the simulator: what `sources` has, imported when it is first asked for."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from srt3d_ros.datasets.sources import *

__all__ = ["CONVERTERS", "FILE_READERS", "SIMULATOR", "Reading", "frame_loaders", "frame_numbers", "open_sensor",
           "read", "read_photons"]


def __getattr__(name: str) -> Any:
    """The command line shows options without the readers: these take as long to import as NumPy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.sources"), name)
