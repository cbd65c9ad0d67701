"""Of `kernels.api`: `prepare`, `blur`, `match` and `residual`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.reference.arithmetic import expected, parts, pixel_z


def prepare(sums, photons, equaliser, used, scratch=None):
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched, counts = np.zeros((padded_rows, 2 * m, padded_cols)), np.zeros((padded_rows, padded_cols))
    maps.crop(matched, rows, cols)[:] = parts(sums.astype(complex) * equaliser)
    maps.crop(counts, rows, cols)[:] = photons * used.astype(np.float64)
    return matched, counts


def blur(values, weights, step):
    rows, channels, cols = values.shape
    radius = len(weights) // 2
    cells = np.zeros((-(-rows // step), channels, -(-cols // step)))
    for i, j in np.ndindex(rows, cols):
        cells[i // step, :, j // step] += values[i, :, j]
    around, pooled = np.pad(cells, ((radius, radius), (0, 0), (radius, radius))), np.empty(cells.shape)
    for i, j in np.ndindex(len(cells), cells.shape[2]):
        window = around[i:i + len(weights), :, j:j + len(weights)]
        pooled[i, :, j] = np.einsum("a,acb,b->c", weights, window, weights)
    return pooled


def match(matched, energy, bin_frequencies, num_bins, surfaces):
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
    return depth, intensity


def residual(frame, state, terms, layer, scratch=None):
    m = len(frame.energy)
    out = np.zeros(frame.matched.shape)
    for i, j in np.argwhere(frame.exposure > 0):
        z = pixel_z(frame.matched, i, j)
        for k in range(state.shape[1]):
            if k != layer:
                shown = max(terms[i, k, maps.VALUE, j], 0) / frame.total_energy
                z = z - expected(shown, float(state[i, k, maps.DEPTH, j]), frame)
        out[i, :m, j], out[i, m:, j] = z.real, z.imag
    return out
