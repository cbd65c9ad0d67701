"""PointCloud: what a reconstruction gives."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor import SensorModel


def points_of(intensity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where the points of K layers lie, sorted by pixel, the strongest of a pixel first.

    Args:
        intensity: float32 [rows, K, cols]; 0 = no point.

    Returns:
        row, layer, col, and rank: 0 for the strongest point of its pixel; int [N] each.
    """
    order = np.argsort(-intensity, axis=1, kind="stable")
    row, col, rank = np.nonzero(np.take_along_axis(intensity, order, axis=1).swapaxes(1, 2) > 0)
    return row, order[row, rank, col], col, rank


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of one frame, sorted by pixel, the strongest of a pixel first, and the background of every pixel.

    Args:
        row, col: uint16 [N].
        depth_bins: float32 [N], the bin on which irf[irf_ref] sits, in [0, T).
        intensity: float32 [N], expected signal photons of that return in the frame.
        depth_std_bins: float32 [N], standard deviation of `depth_bins`: photon noise, and where photons are pooled also
            what the surface does within the pool.
        xyz: float32 [N, 3], metres, sensor's frame.
        surface: uint8 [N], 0 for the strongest point of its pixel, 1 for the next, …
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
    def from_layers(cls, sensor: SensorModel, depth: np.ndarray, intensity: np.ndarray, std: np.ndarray,
                    background: np.ndarray, stamp_ns: int) -> "PointCloud":
        """The cloud of K layers of surfaces.

        Args:
            sensor: places the points.
            depth: float32 [rows, K, cols], bins.
            intensity: float32 [rows, K, cols]; 0 = no point.
            std: float32 [rows, K, cols], of the depths, bins.
            background: float32 [rows, cols], expected background photons.
            stamp_ns: start of acquisition.
        """
        row, layer, col, rank = points_of(intensity)
        depth, intensity, std = (values[row, layer, col].astype(np.float32) for values in (depth, intensity, std))
        depth %= np.float32(sensor.num_bins)
        depth[depth >= sensor.num_bins] = 0                     # where rounding made it T
        return cls(row.astype(np.uint16), col.astype(np.uint16), depth, intensity, np.clip(std, 1e-6, sensor.num_bins),
                   sensor.xyz(row, col, depth), rank.astype(np.uint8), background.astype(np.float32), stamp_ns)

    def __len__(self) -> int:
        return len(self.row)

    def image(self, field: str, surface: int = 0) -> np.ndarray:
        """One value per pixel of `depth_bins`, `intensity` or `depth_std_bins`; float32 [rows, cols], NaN = no point.

        The depth image in metres is `range_image`.
        """
        chosen = self.surface == surface
        out = np.full(self.background.shape, np.nan, np.float32)
        out[self.row[chosen], self.col[chosen]] = getattr(self, field)[chosen]
        return out

    def range_image(self) -> np.ndarray:
        """Range along the ray of the strongest point, metres; float32 [rows, cols], NaN = no point."""
        chosen = self.surface == 0
        out = np.full(self.background.shape, np.nan, np.float32)
        out[self.row[chosen], self.col[chosen]] = np.linalg.norm(self.xyz[chosen], axis=1)
        return out
