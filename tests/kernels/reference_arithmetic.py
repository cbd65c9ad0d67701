"""What the parts of the reference share: a pixel's statistics as complex numbers z_l, a circle's differences."""

import numpy as np

from srt3d_ros.core.layout import DEPTH, INTENSITY


def angular(data) -> np.ndarray:
    """ω_l, radians per bin."""
    return 2 * np.pi * data.cycles.astype(np.float64)


def pixel_z(matched, i, j) -> np.ndarray:
    """Statistics of pixel (i, j), complex [m]."""
    m = matched.shape[1] // 2
    return matched[i, :m, j].astype(np.float64) + 1j * matched[i, m:, j]


def response_of(z, depth, data) -> float:
    """Of photons with statistics z to the matched filter at a depth: Σ_l Re(z_l exp(−i ω_l t))."""
    return (z * np.exp(-1j * angular(data) * depth)).real.sum()


def expected(photons, depth, data) -> np.ndarray:
    """The z of this many photons from a surface at a depth: photons · |ĥ_l|² exp(i ω_l t)."""
    return photons * data.energy * np.exp(1j * angular(data) * depth)


def unexplained(data, state) -> np.ndarray:
    """What each surface of a pixel sees of its photons: all but what the other surfaces explain, [rows, cols, K, m]."""
    tall, surfaces, _, wide = state.shape
    out = np.zeros((tall, wide, surfaces, len(data.energy)), complex)
    for i, j in np.ndindex(tall, wide):
        by = [expected(data.exposure[i, j] * record[INTENSITY], record[DEPTH], data) for record in state[i, :, :, j]]
        for k in range(surfaces):
            out[i, j, k] = pixel_z(data.matched, i, j) - sum(by[o] for o in range(surfaces) if o != k)
    return out


def wrap(difference, period):
    """The difference of two depths on a circle."""
    return difference - period * np.rint(difference / period)
