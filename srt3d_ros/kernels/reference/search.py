"""The start, of `kernels.api`: `prepare`, `blur`, `match`, `search`, `drop_weak` and `residual`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import APART, DOUBTFUL, FAINTEST, STAY
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, VALUE
from srt3d_ros.kernels.reference.arithmetic import EPSILON, angular, expected, noise_ratio, pixel_z, response_of, wrap
from srt3d_ros.kernels.reference.likelihood import surprise

FOUND = [DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE]        # fields that a search fills in


def prepare(sums, photons, equaliser, used, scratch=None, taken=None, shown=None):
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched, counts = np.zeros((padded_rows, 2 * m, padded_cols)), np.zeros((padded_rows, padded_cols))
    z = (sums.astype(complex) * equaliser - (0 if taken is None else taken[..., None] * shown)).swapaxes(1, 2)
    maps.crop(matched, rows, cols)[:] = np.concatenate([z.real, z.imag], axis=1)
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
                shown = max(terms[i, k, VALUE, j], 0) / frame.total_energy
                z = z - expected(shown, float(state[i, k, DEPTH, j]), frame)
        out[i, :m, j], out[i, m:, j] = z.real, z.imag
    return out


def search(frame, matched, state, layer, sigma, step, enough, scratch=None, carried=None, confirmed=0.0,
           slope=(0.0, 0.0), before=None):
    size = frame.shape
    view, exposure = maps.crop(state, *size), maps.crop(frame.exposure, *size)
    seen = maps.crop(state if before is None else before, *size)
    is_open = (exposure > 0) & (seen[:, layer, INTENSITY] == 0)
    if layer > 0:
        is_open &= seen[:, layer - 1, INTENSITY] > 0
    pools = _sheared(maps.crop(matched, *size), slope, frame), maps.crop(frame.counts, *size)[:, None], \
        exposure[:, None]
    share = 1.0
    if sigma > 0:
        weights, share = maps.window_weights(sigma / step), 0.5
        pools = [blur(values * is_open[:, None], w, step) for values, w in zip(pools, (weights, weights**2, weights))]
    pooled, counts, light = pools[0], pools[1][:, 0].astype(float), np.maximum(pools[2][:, 0], EPSILON)
    depth, signal = (found[:, 0] for found in match(pooled, frame.energy, frame.bin_frequencies, frame.num_bins, 1))
    for i, j in np.argwhere(is_open & ((view[:, layer, INTENSITY] == 0) | (view[:, layer, SCORE] < DOUBTFUL))):
        cell = i // step, j // step
        first_row, first_col = (first // step for first in frame.origin)
        corner = depth[cell] + step * (slope[0] * (first_col + cell[1]) + slope[1] * (first_row + cell[0]))

        def measured(t, slopes, signal):
            """The fields FOUND of a surface at depth t with this signal in the pixel's cell."""
            score = _score(frame, signal, counts[cell], share) / noise_ratio(frame, t)
            return np.array([t, *slopes, signal / light[cell], _std(frame, signal, counts[cell], share), score])

        point = measured(corner % frame.num_bins, slope, signal[cell])
        point[0] = (point[0] + slope[0] * (j % step) + slope[1] * (i % step)) % frame.num_bins
        if carried is not None and carried[MARGIN + i, layer, INTENSITY, MARGIN + j] > 0:
            t, *slopes = carried[MARGIN + i, layer, FOUND[:3], MARGIN + j].astype(float)
            old = measured(t, slopes, response_of(pixel_z(pooled, *cell), t, frame) / frame.total_energy)
            if old[-1] > confirmed and point[-1]**2 - old[-1]**2 < 2 * STAY:
                view[i, layer, FOUND, j] = old
                continue
        known = view[i, :layer, :, j]
        least = max(enough, view[i, layer, SCORE, j]) if view[i, layer, INTENSITY, j] > 0 else enough
        if point[-1] > least and (layer == 0 or _is_new(frame, known, point[0], signal[cell] / light[cell])):
            view[i, layer, FOUND, j] = point


def _sheared(matched, slope, frame):
    """z_l exp(−i ω_l slope · position) of an image."""
    rows, channels, cols = matched.shape
    right, down = (first + np.arange(pixels) for first, pixels in zip(frame.origin[::-1], (cols, rows)))
    along = slope[0] * right + slope[1] * down[:, None]
    z = (matched[:, :channels // 2] + 1j * matched[:, channels // 2:]) * np.exp(
        -1j * angular(frame)[:, None] * along[:, None])
    return np.concatenate([z.real, z.imag], axis=1)


def _score(frame, signal, counts, share) -> float:
    photons = max(counts / share, EPSILON)
    return np.sqrt(photons / share) * surprise(signal * frame.total_energy, photons, frame)


def _std(frame, signal, counts, share) -> float:
    signal = max(signal, EPSILON)
    background = max(counts / share - signal, 0)
    spread = share * (signal * frame.moments[0] + background * frame.moments[1])
    return min(np.sqrt(spread) / (signal * frame.curvature), frame.num_bins)


def _is_new(frame, known, depth, intensity) -> bool:
    """Whether a point is a surface beside the known ones [k, FIELDS] of its pixel: resolved, not too faint."""
    apart = np.abs(wrap(known[:, DEPTH] - depth, frame.num_bins)) > APART * frame.resolution_bins
    return bool((apart | (known[:, INTENSITY] == 0)).all() and intensity > FAINTEST * known[0, INTENSITY])


def drop_weak(state, weak):
    state[:, :, INTENSITY][state[:, :, SCORE] < weak] = 0
