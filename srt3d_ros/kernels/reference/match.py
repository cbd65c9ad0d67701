"""Matching pursuit of every pixel's strongest returns: `match` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.reference.arithmetic import pixel_z, written


def match(matched, energy, bin_frequencies, num_bins, surfaces, out=None):
    """Loop over pixels and surfaces: highest cell, parabola through its neighbours, residual."""
    rows, _, cols = matched.shape
    omega, energy = 2 * np.pi * bin_frequencies.astype(np.float64), energy.astype(np.float64)
    cells = 16 * int(np.ceil(4 * np.round(bin_frequencies.max() * num_bins) / 16))
    t = np.arange(cells) * num_bins / cells
    depth, intensity = (np.zeros((rows, surfaces, cols)) for _ in range(2))
    for i, j in np.ndindex(rows, cols):
        rest = pixel_z(matched, i, j)
        for k in range(surfaces):
            response = (rest * np.exp(-1j * np.outer(t, omega))).real.sum(axis=1)
            top = int(response.argmax())
            before, peak, after = response[top - 1], response[top], response[(top + 1) % cells]
            bend = before - 2 * peak + after
            shift = (before - after) / 2 / bend if bend < 0 else 0.0
            value = peak - (before - after) / 4 * shift
            depth[i, k, j] = (top + shift) * num_bins / cells
            intensity[i, k, j] = value / energy.sum()
            rest = rest - value / energy.sum() * energy * np.exp(1j * omega * depth[i, k, j])
    if out is None:
        return depth, intensity
    written(depth, out[0]), written(intensity, out[1])
    return out
