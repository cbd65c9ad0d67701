"""Found: what one frame shows, and what it leaves unexplained."""

from typing import Any, NamedTuple, Self

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud


class Unexplained(NamedTuple):
    """What the points leave unexplained of a frame, by the kernel `unexplained`: sums over all pixels.

    Each pixel counts by its share, background photons over all photons.

    Args:
        left: complex64 [m], the sketch's phase sums less those of the points.
        seen: complex64 [m], the phase sums of the points.
        own, taken: photons that are not the points', and photons of the background that was removed.
        noise: variance of each number of `left`.
        misfit: Σ |z_l − what the points explain|², in units of the photons' noise; all pixels count alike.
    """

    left: np.ndarray
    seen: np.ndarray
    own: np.float64
    taken: np.float64
    noise: np.float64
    misfit: np.float64

    @classmethod
    def unpacked(cls, sums: np.ndarray) -> Self:
        """From the kernels' float32 [4m + 4]: real and imaginary parts of `left`, those of `seen`, the four numbers."""
        left_real, left_imaginary, seen_real, seen_imaginary = sums[:-4].reshape(4, -1)
        return cls(left_real + 1j * left_imaginary, seen_real + 1j * seen_imaginary, *sums[-4:].astype(np.float64))


class Found(NamedTuple):
    """What a frame shows, and what the next frames need of it.

    Args:
        rest: float32 [rows, cols], photons that are not the points', at least 0 in each pixel.
        unexplained: what the points leave unexplained; None unless asked for.
        points: float32 [rows', K, FIELDS, cols'] (`kernels.maps`) on the device, to start the next frame from.
    """

    cloud: PointCloud
    rest: np.ndarray
    unexplained: Unexplained | None
    points: Any
