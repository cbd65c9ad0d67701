"""PointCloud: what a reconstruction returns."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole, Projection
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.errors import require

# Which point of a pixel comes first: the field that a pixel's points are sorted by, and its sign.
SURFACE_ORDERS = {"strongest": ("intensity", -1), "nearest": ("depth_bins", 1), "farthest": ("depth_bins", -1)}


class Estimate(NamedTuple):
    """What a method makes of a frame; N points, sorted by pixel, the strongest of a pixel first.

    Args:
        state: float32 [rows', K, FIELDS, cols'] (`kernels.maps`) on the device, valid until the next frame starts;
            None of baselines.
        left: what the points leave unexplained (`unexplained` of the kernels); empty unless asked for.
        rest: float32 [rows, cols], photons that are not the points', at least 0 in each pixel.
        background: float32 [rows, cols], background photons.
        row, col, rank: uint16, uint16, uint8 [N], the points' pixels, and their order within these.
        values: float32 [3, N]: depth (bins), intensity (photons), standard deviation (bins).
        xyz: float32 [N, 3], metres.
    """

    state: np.ndarray | None
    left: np.ndarray
    rest: np.ndarray
    background: np.ndarray
    row: np.ndarray
    col: np.ndarray
    rank: np.ndarray
    values: np.ndarray
    xyz: np.ndarray

    @property
    def misfit(self) -> float:
        """Σ |z_l − what the points explain|², in units of the photons' noise."""
        return float(self.left[-1])


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of one frame, sorted by pixel, the strongest of a pixel first, and the background of every pixel.

    Args:
        row, col: uint16 [N].
        depth_bins: float32 [N], depth (see SensorModel), in [0, T).
        intensity: float32 [N], expected signal photons of that return in the frame.
        depth_std_bins: float32 [N], of `depth_bins`: photon noise, edges, and relief in the pool; NaN of the baselines.
        xyz: float32 [N, 3], metres, sensor's frame.
        surface: uint8 [N], 0 for the first point of its pixel, 1 for the next, …
        background: float32 [rows, cols], expected background photons in the frame, over all T bins.
        stamp_ns: start of acquisition, passed through from the photons.
    """

    row: np.ndarray
    col: np.ndarray
    depth_bins: np.ndarray
    intensity: np.ndarray
    depth_std_bins: np.ndarray
    xyz: np.ndarray
    surface: np.ndarray
    background: np.ndarray
    stamp_ns: int = 0

    @classmethod
    def from_layers(cls, sensor: SensorModel, depth: np.ndarray, intensity: np.ndarray, background: np.ndarray,
                    stamp_ns: int) -> "PointCloud":
        """The cloud of K layers of surfaces, float32 [rows, K, cols]: depth in bins, intensity 0 = no point."""
        (_, layers, cols), values = intensity.shape, intensity.swapaxes(1, 2)          # flat indices: fast ones
        order = np.argsort(-values, axis=2, kind="stable")
        place = np.flatnonzero(np.take_along_axis(values, order, axis=2) > 0)
        (pixel, rank), layer = np.divmod(place, layers), order.take(place)
        row, col = np.divmod(pixel, cols)
        depth, intensity = (each.take((row * layers + layer) * cols + col).astype(np.float32)
                            for each in (depth, intensity))
        depth = sensor.wrapped(depth)
        return cls(row.astype(np.uint16), col.astype(np.uint16), depth, intensity, np.full_like(depth, np.nan),
                   sensor.xyz(row, col, depth), rank.astype(np.uint8), background.astype(np.float32), stamp_ns)

    @classmethod
    def of(cls, found: Estimate, sketch: Sketch) -> "PointCloud":
        """The cloud of an estimate of a sketch."""
        return cls(found.row, found.col, *found.values, found.xyz, found.rank, found.background, sketch.stamp_ns)

    def __len__(self) -> int:
        return len(self.row)

    def image(self, field: str, surface: int = 0) -> np.ndarray:
        """One value per pixel of `depth_bins`, `intensity` or `depth_std_bins`; float32 [rows, cols], NaN = no point.

        In metres: `range_image` and `depth_image`.
        """
        return self._image(getattr(self, field), surface)

    def range_image(self) -> np.ndarray:
        """Range along the ray of each pixel's first point, metres; float32 [rows, cols], NaN = no point."""
        return self._image(self._range_m())

    def depth_image(self, projection: Projection) -> np.ndarray:
        """What a depth image shows (REP-118) of the first points; float32 [rows, cols], metres, NaN = no point.

        That is z in the optical frame for a pinhole, the range along the ray for a scanner.
        """
        return self._image(self.xyz[:, 2]) if isinstance(projection, Pinhole) else self.range_image()

    def within(self, min_m: float = 0.0, max_m: float = np.inf) -> Self:
        """Only the points whose range along the ray is from `min_m` to `max_m` metres; `surface` counts those left."""
        if min_m <= 0 and max_m == np.inf:
            return self
        range_m = self._range_m()
        kept = np.flatnonzero((range_m >= min_m) & (range_m <= max_m))
        if len(kept) == len(self):
            return self
        row, col = self.row[kept], self.col[kept]
        begins = np.flatnonzero((np.diff(row, prepend=-1) != 0) | (np.diff(col, prepend=-1) != 0))
        rank = np.arange(len(kept)) - np.repeat(begins, np.diff(begins, append=len(kept)))
        return replace(self._only(kept), surface=rank.astype(np.uint8))

    def _only(self, kept: np.ndarray) -> Self:
        """The points of these indices."""
        return replace(self, **{name: getattr(self, name)[kept] for name in (
            "row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")})

    def ordered(self, surface_order: str) -> Self:
        """The cloud with the `strongest`, `nearest` or `farthest` point of each pixel first; ties keep their order."""
        require(surface_order in SURFACE_ORDERS, "surface_order", surface_order, " or ".join(SURFACE_ORDERS))
        field, sign = SURFACE_ORDERS[surface_order]
        key, later = sign * getattr(self, field), np.flatnonzero(self.surface)
        if (key[later - 1] <= key[later]).all():
            return self
        order = np.lexsort((key, np.cumsum(self.surface == 0)))
        return replace(self._only(order), surface=self.surface)

    def _range_m(self) -> np.ndarray:
        return np.sqrt(np.einsum("ij,ij->i", self.xyz, self.xyz))       # several times faster than np.linalg.norm

    def _image(self, values: np.ndarray, surface: int = 0) -> np.ndarray:
        chosen = self.surface == surface
        out = np.full(self.background.shape, np.nan, np.float32)
        out[self.row[chosen], self.col[chosen]] = values[chosen]
        return out
