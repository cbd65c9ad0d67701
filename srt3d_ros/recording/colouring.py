"""The colours of recorded clouds: by which quantity, with which map, over which range."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from srt3d_ros.colours import CLOUD_MAP, AdaptiveRange, colour_table, levels, packed_colour_table
from srt3d_ros.core.projection import Projection
from srt3d_ros.viewpoint import sensor_axes

COLOUR_BY = ("intensity", "height", "depth_std", "range")
_STEPS = 64             # distinct colours: more look the same and cost a byte per point
_LEAST_BRIGHT = 108     # of 255: the brightest channel of the darkest colour that is visible on a dark background


@dataclass(frozen=True)
class Colouring:
    """How points are coloured.

    Args:
        by: one of COLOUR_BY.
        map: one of colours.COLOUR_MAPS.
        fixed_range: (low, high) in photons or metres; None = follow the clouds slowly.
    """

    by: str = "intensity"
    map: str = CLOUD_MAP
    fixed_range: tuple[float, float] | None = None


class CloudColours:
    """Computes the colours of one cloud after the other; `projection` says which way is up."""

    def __init__(self, colouring: Colouring, projection: Projection | None):
        self._by, self._table = colouring.by, _visible_table(colouring.map)
        self._up = sensor_axes(projection)[2].astype(np.float32)
        self._range = AdaptiveRange(fixed=colouring.fixed_range)

    def __call__(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """uint32 [N], 0xRRGGBBAA. By the intensity where the quantity to colour by is missing."""
        by = self._by if self._by in ("height", "range", *columns) else "intensity"
        if by == "height":
            values = columns["xyz"] @ self._up
        else:
            values = np.linalg.norm(columns["xyz"], axis=1) if by == "range" else columns[by]
        low, high = self._range.update(values)
        return self._table[levels(values, low, high, root=by == "intensity")]


@cache
def _visible_table(name: str) -> np.ndarray:
    """A map's colours from the first that is visible on a dark background, in _STEPS steps; uint32 [256]."""
    first = int(np.argmax(colour_table(name).max(axis=1) >= _LEAST_BRIGHT))
    step = np.arange(256) * _STEPS // 256
    return packed_colour_table(name)[np.rint(first + step * (255 - first) / (_STEPS - 1)).astype(int)]
