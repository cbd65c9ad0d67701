"""Compressive histograms: what other cameras would keep of a pixel's photons, and the depth that one pixel's codes say.

    F. Gutierrez-Barragan, A. Ingle, T. Seets, M. Gupta, A. Velten, "Compressive single-photon 3D cameras", CVPR 2022.

A pixel with the histogram y of T bins keeps K codes c = Cᵀ y, so each photon in bin b adds row b of the coding matrix C
[T, K]. Fourier codes are sketches: rows of `core.sketching.phase_table`, with other frequencies than ours.
"""

import numpy as np

from srt3d_ros.core.sensor import SensorModel

CELLS = 2**22           # responses of pixels that are computed together: 16 MB
TIE = 1e-6              # relative difference of responses that rounding may make
TINY = 1e-12


def coarse_codes(num_bins: int, width: int) -> np.ndarray:
    """Coarse histogram: code j counts bins j · width to (j + 1) · width − 1; float32 [T, ⌈T / width⌉]."""
    return np.eye(-(-num_bins // width), dtype=np.float32).repeat(width, axis=0)[:num_bins]


def truncated_fourier(num_bins: int, sketch_size: int) -> tuple[int, ...]:
    """The frequencies of truncated Fourier codes: the m lowest."""
    return tuple(range(1, min(sketch_size, (num_bins - 1) // 2) + 1))


def gray_fourier(num_bins: int, sketch_size: int) -> tuple[int, ...]:
    """The frequencies of Gray-based Fourier codes: 1, 2, 4, 8 … below T / 2, then the lowest that are left."""
    most = (num_bins - 1) // 2
    doubling = [2**bit for bit in range(most.bit_length())]
    others = [k for k in range(1, most + 1) if k not in doubling]
    return tuple([*doubling, *others][:sketch_size])


def gray_codes(num_bins: int, count: int) -> np.ndarray:
    """Continuous Gray codes, ±1 and linear between the middles of the 2ᴷ cells, of mean 0; float64 [T, K], 2ᴷ ≤ T."""
    cell = np.arange(2**count)
    signs = 2.0 * ((cell ^ cell >> 1)[:, None] >> np.arange(count) & 1) - 1
    position = (np.arange(num_bins) + 0.5) * 2**count / num_bins - 0.5
    low = np.floor(position).astype(int)
    share = (position - low)[:, None]
    codes = (1 - share) * signs[low % 2**count] + share * signs[(low + 1) % 2**count]
    return codes - codes.mean(axis=0)


def expected_codes(codes: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """What a surface at each depth leaves, scaled to length 1; float32 [K, T].

    D(t) = Σ_b h(b − t) (C(b) − C̄), with the mean C̄ of the rows taken out, as an even background leaves it.
    """
    irf = np.atleast_2d(sensor.irf).mean(axis=0, dtype=np.float64)
    pulse = np.zeros(sensor.num_bins)
    np.add.at(pulse, (np.arange(len(irf)) - sensor.irf_ref) % sensor.num_bins, irf)
    spectrum = np.fft.rfft(codes - codes.mean(axis=0), axis=0) * np.conj(np.fft.rfft(pulse))[:, None]
    expected = np.fft.irfft(spectrum, sensor.num_bins, axis=0)
    lengths = np.linalg.norm(expected, axis=1, keepdims=True)
    return np.ascontiguousarray((expected / np.maximum(lengths, TINY)).T, np.float32)


def correlate(codes, expected: np.ndarray) -> np.ndarray:
    """Depth of each pixel by normalised cross-correlation, arg max_t c · D(t) / ‖D(t)‖ (as in the paper), in bins.

    A parabola refines the peak; of a flat top, which coarse bins give, it is the middle.

    Args:
        codes: [pixels, K], an array or a scipy.sparse one.
        expected: from `expected_codes`.

    Returns:
        float64 [pixels], in [−½, T).
    """
    num_bins, depths = expected.shape[1], []
    several = max(CELLS // num_bins, 1)
    for first in range(0, codes.shape[0], several):
        response = codes[first:first + several] @ expected
        each, begin = np.arange(len(response)), response.argmax(axis=1)
        left, peak, right = (response[each, (begin + step) % num_bins] for step in (-1, 0, 1))
        bend = left - 2 * peak + right
        shift = np.divide(left - right, 2 * bend, out=np.zeros_like(bend), where=bend < 0).clip(-0.5, 0.5)
        enough = np.where(peak > 0, (1 - TIE) * peak, np.inf)       # no photons, no top
        before, after = (_run(response, begin, enough, step) for step in (-1, 1))
        depths.append(begin + np.where(before + after > 0, (after - before) / 2, shift))
    return np.concatenate(depths)


def _run(response: np.ndarray, begin: np.ndarray, enough: np.ndarray, step: int) -> np.ndarray:
    """How many bins beside `begin`, to one side, respond as much; int [pixels]."""
    length, on = np.zeros_like(begin), np.arange(len(begin))
    while len(on):
        at = begin[on] + step * (length[on] + 1)
        inside = (at >= 0) & (at < response.shape[1])
        on, at = on[inside], at[inside]
        on = on[response[on, at] >= enough[on]]
        length[on] += 1
    return length
