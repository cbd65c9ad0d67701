"""PointCloud: the points of a frame."""

from dataclasses import KW_ONLY, dataclass, replace
from typing import Self

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.errors import quoted, require
from srt3d_ros.kernels.devices import kernels_for

IMAGES = ("depth_bins", "intensity", "depth_std_bins")
POINT_FIELDS = ("row", "col", *IMAGES, "xyz", "surface")


@dataclass(frozen=True, eq=False, repr=False)
class PointCloud:
    """The points of one frame, sorted by pixel, the strongest of a pixel first, and the background of every pixel.

    Args:
        row, col: uint16 [N].
        depth_bins: float32 [N], depth (see SensorModel), in [0, T).
        intensity: float32 [N], expected signal photons of that return in the frame.
        depth_std_bins: float32 [N], of `depth_bins`: photon noise, edges, and relief in the pool; NaN from the
            baselines.
        xyz: float32 [N, 3], metres, sensor's frame.
        surface: uint8 [N], 0 for the first point of its pixel, 1 for the next, …
        background: float32 [rows, cols], expected background photons in the frame, over all T bins.
        stamp_ns: start of acquisition, passed through from the photons.
        sensor: places the points: that of the photons, behind a gate if there is one.
        method, surfaces, device: what made the cloud: the method's name, the most surfaces in a pixel, "cpu" or "cuda".
        photons: number of photons in the frame.
        frequencies: the integers k_l of the sketch; none if the method works on photons.
        sketch_ms, reconstruct_ms: how long sketching and reconstructing took, milliseconds; None if not measured.
        clutter: the largest factor by which an uneven background raises the scores of `pooled`, 1 if it is even; None:
            not known (another method, or read from a file).
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
    _: KW_ONLY
    sensor: SensorModel
    method: str = ""
    surfaces: int = 1
    device: str = "cpu"
    photons: int = 0
    frequencies: tuple[int, ...] = ()
    sketch_ms: float | None = None
    reconstruct_ms: float | None = None
    clutter: float | None = None

    @classmethod
    def from_layers(cls, sensor: SensorModel, depth: np.ndarray, intensity: np.ndarray, background: np.ndarray,
                    stamp_ns: int) -> Self:
        """The cloud of K layers of surfaces, float32 [rows, K, cols]: depth in bins, intensity 0 = no point."""
        depth, intensity, background = sensor.wrapped(depth), *(
            np.asarray(values, np.float32) for values in (intensity, background))
        points = kernels_for("cpu").collect(depth, intensity, np.full_like(depth, np.nan), *listing(sensor))
        return cls.of_list(sensor, points, background, stamp_ns)

    @classmethod
    def of_list(cls, sensor: SensorModel, unpacked: tuple, background: np.ndarray, stamp_ns: int) -> Self:
        """The cloud of what the kernel `unpack` returns."""
        row, col, rank, (depth, intensity, std), xyz = unpacked
        return cls(row, col, depth, intensity, std, xyz, rank, background, stamp_ns, sensor=sensor)

    def __len__(self) -> int:
        return len(self.row)

    def __repr__(self) -> str:
        range_m = self._range_m()
        where = f" at {range_m.min():.4g} to {range_m.max():.4g} m" if len(self) else ""
        return (f"{type(self).__name__} of {len(self):,} points{where}, from {self.photons:,} photons of "
                f"{self.sensor.rows} × {self.sensor.cols} pixels")

    @property
    def pixel(self) -> np.ndarray:
        """row · cols + col of the points, int64 [N]."""
        return self.row.astype(np.int64) * self.sensor.cols + self.col

    def image(self, field: str, surface: int = 0) -> np.ndarray:
        """One value per pixel of `depth_bins`, `intensity` or `depth_std_bins`; float32 [rows, cols], NaN = no point.

        `surface` is 0 for the first point of each pixel. In metres: `range_image` and `depth_image`.
        """
        require(field in IMAGES, "field", field, " or ".join(IMAGES))
        require(isinstance(surface, int), "surface", quoted(surface), "an integer, 0 for the strongest")
        return self._image(getattr(self, field), surface)

    def range_image(self) -> np.ndarray:
        """Range along the ray of each pixel's first point, metres; float32 [rows, cols], NaN = no point."""
        return self._image(self._range_m())

    def depth_image(self) -> np.ndarray:
        """What a depth image shows (REP-118) of the first points; float32 [rows, cols], metres, NaN = no point.

        That is z in the optical frame for a pinhole, the range along the ray for a scanner.
        """
        return self._image(self.xyz[:, 2]) if isinstance(self.sensor.projection, Pinhole) else self.range_image()

    def within(self, min_m: float = 0.0, max_m: float = np.inf) -> Self:
        """Only the points whose range along the ray is from `min_m` to `max_m` metres; `surface` counts those left."""
        if min_m <= 0 and max_m == np.inf:
            return self
        range_m = self._range_m()
        inside = np.flatnonzero((range_m >= min_m) & (range_m <= max_m))
        kept = replace(self, **{name: getattr(self, name)[inside] for name in POINT_FIELDS})
        place, pixel = np.arange(len(kept)), kept.pixel
        begin = np.maximum.accumulate(np.where(np.diff(pixel, prepend=-1) != 0, place, 0))     # of its pixel
        return replace(kept, surface=(place - begin).astype(np.uint8))

    def _range_m(self) -> np.ndarray:
        return self.sensor.range_m(self.depth_bins).astype(np.float32)      # negative before the sensor

    def _image(self, values: np.ndarray, surface: int = 0) -> np.ndarray:
        chosen = self.surface == surface
        image = np.full(self.background.shape, np.nan, np.float32)
        image[self.row[chosen], self.col[chosen]] = values[chosen]
        return image


def listing(sensor: SensorModel) -> tuple[np.ndarray, float, float, int]:
    """What the kernel `collect` needs of a sensor: rays, metres per bin and at bin 0, T."""
    return sensor.rays, sensor.bin_width_m, float(sensor.range_m(0)), sensor.num_bins
