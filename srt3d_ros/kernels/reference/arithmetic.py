"""What the steps share: a pixel's statistics as complex numbers z_l, and where results go."""

import numpy as np

EPSILON = 1e-6        # photons: added nothing, divided by at least this


def angular(frame) -> np.ndarray:
    """ω_l = 2π k_l / T, radians per bin."""
    return 2 * np.pi * frame.bin_frequencies.astype(np.float64)


def pixel_z(matched, i, j) -> np.ndarray:
    """z_l of pixel (i, j), complex [m]."""
    m = matched.shape[1] // 2
    return matched[i, :m, j].astype(np.float64) + 1j * matched[i, m:, j]


def parts(z) -> np.ndarray:
    """complex [rows, cols, m] → real parts before imaginary ones, [rows, 2m, cols]."""
    return np.concatenate([z.real, z.imag], axis=2).swapaxes(1, 2)


def response_of(z, depth, frame) -> float:
    """Of photons with statistics z to the matched filter at a depth: Σ_l Re(z_l exp(−i ω_l t))."""
    return (z * np.exp(-1j * angular(frame) * depth)).real.sum()


def expected(photons, depth, frame) -> np.ndarray:
    """The z of this many photons from a surface at a depth: photons · |ĥ_l|² exp(i ω_l t)."""
    return photons * frame.energy * np.exp(1j * angular(frame) * depth)


def noise_ratio(frame, depth):
    """By how much scores at these depths exceed standard deviations: `clutter` at the nearest bin."""
    return 1.0 if frame.clutter is None else frame.clutter[np.rint(depth).astype(np.int64) % frame.num_bins]


def written(result, out):
    """The result, in `out` if that is given."""
    if out is None:
        return result
    out[...] = result
    return out
