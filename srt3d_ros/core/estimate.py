"""Estimate: what the kernels make of one frame, before it becomes a Cloud."""

from typing import NamedTuple, Self

import numpy as np


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


class Estimate(NamedTuple):
    """What the kernels make of a frame: N points, sorted by pixel, the strongest of a pixel first.

    Args:
        state: float32 [rows', K, FIELDS, cols'] (`kernels.maps`) on the device, valid until the next frame starts;
            None from the baselines.
        unexplained: what the points leave unexplained; None unless asked for.
        background: float32 [rows, cols], background photons.
        rest: float32 [rows, cols], photons that are not the points', at least 0 in each pixel.
        row, col, rank: uint16, uint16, uint8 [N], the points' pixels, and their order within these.
        values: float32 [3, N]: depth (bins), intensity (photons), standard deviation (bins).
        xyz: float32 [N, 3], metres.
    """

    state: np.ndarray | None
    unexplained: Unexplained | None
    rest: np.ndarray
    background: np.ndarray
    row: np.ndarray
    col: np.ndarray
    rank: np.ndarray
    values: np.ndarray
    xyz: np.ndarray
