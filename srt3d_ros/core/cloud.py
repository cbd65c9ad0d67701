"""PointCloud: what a reconstruction gives."""

from dataclasses import dataclass

import numpy as np


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
