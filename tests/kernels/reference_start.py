"""The start of a reconstruction in plain float64 NumPy: a part of `reference`."""

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.layout import DEPTH, INTENSITY, MARGIN, SCORE, STD, WINDOW
from srt3d_ros.kernels.constants import APART, FAINTEST, NARROWEST, STAY

from .reference_arithmetic import angular, expected, pixel_z, response_of, unexplained, wrap


def prepare(sums, photons, equaliser, used, scratch=None):
    matched = sums.astype(complex) * equaliser
    noise = photons * used.astype(np.float64)
    planes = np.concatenate([matched.real, matched.imag], axis=2)
    return layout.pad(planes).astype(np.float64), layout.pad(noise).astype(np.float64)


def blur(values, weights, step):
    rows, channels, cols = values.shape
    radius = (len(weights) - step) // 2
    around = np.pad(values.astype(np.float64), ((radius, radius + step), (0, 0), (radius, radius + step)))
    out = np.zeros((-(-rows // step), channels, -(-cols // step)))
    for i in range(out.shape[0]):
        for j in range(out.shape[2]):
            window = around[i * step:i * step + len(weights), :, j * step:j * step + len(weights)]
            out[i, :, j] = np.einsum("a,acb,b->c", weights, window, weights)
    return out


def match(matched, energy, cycles, num_bins, surfaces):
    rows, _, cols = matched.shape
    omega, energy = 2 * np.pi * cycles.astype(np.float64), energy.astype(np.float64)
    cells = 16 * int(np.ceil(4 * np.round(cycles.max() * num_bins) / 16))
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


def search(data, matched, state, layer, sigma, weights, step, enough, scratch=None, carried=None, confirmed=0.0):
    size = data.shape
    view, exposure = layout.crop(state, *size), layout.crop(data.exposure, *size)
    is_open = (exposure > 0) & (view[:, layer, INTENSITY] == 0)
    if layer > 0:
        is_open &= view[:, layer - 1, INTENSITY] > 0
    maps, squash = [layout.crop(matched, *size), layout.crop(data.noise, *size)[:, None], exposure[:, None]], 1.0
    if sigma > 0:
        maps = [blur(values * is_open[:, None], w, step) for values, w in zip(maps, (weights, weights**2, weights))]
        squash = 0.5
    pooled, noise, light = maps[0], maps[1][:, 0].astype(float), maps[2][:, 0]
    depth, signal = (found[:, 0] for found in match(pooled, data.energy, data.cycles, data.num_bins, 1))
    for i, j in np.argwhere(is_open):
        a, b = i // step, j // step
        score = _score(data, signal[a, b], noise[a, b], squash) / data.noise_ratio(depth[a, b])
        point = np.zeros(layout.FIELDS)
        point[DEPTH], point[INTENSITY] = depth[a, b] % data.num_bins, signal[a, b] / max(light[a, b], 1e-6)
        point[STD] = _std(data, signal[a, b], noise[a, b], squash)
        point[WINDOW], point[SCORE] = max(sigma, NARROWEST), score
        if carried is not None and carried[MARGIN + i, layer, INTENSITY, MARGIN + j] > 0:
            old = carried[MARGIN + i, layer, :, MARGIN + j].astype(float)
            signal_there = response_of(pixel_z(pooled, a, b), old[DEPTH], data) / data.total_energy
            known = _score(data, signal_there, noise[a, b], squash) / data.noise_ratio(old[DEPTH])
            if known > confirmed and score**2 - known**2 < 2 * STAY:
                old[INTENSITY], old[SCORE] = signal_there / max(light[a, b], 1e-6), known
                old[STD], old[WINDOW] = _std(data, signal_there, noise[a, b], squash), point[WINDOW]
                view[i, layer, :, j] = old
                continue
        if score > enough and (layer == 0 or _is_new(data, view[i, :layer, :, j], point)):
            view[i, layer, :, j] = point


def _score(data, signal, noise, squash) -> float:
    photons, steps = max(noise / squash, 1e-6), len(data.rarity) - 1
    at = np.clip(signal / photons * data.total_energy / data.greatest_response * steps, 0, steps)
    return np.sqrt(photons / squash) * np.interp(at, np.arange(steps + 1), data.rarity)


def _std(data, signal, noise, squash) -> float:
    signal = max(signal, 1e-6)
    background = max(noise / squash - signal, 0)
    spread = squash * (signal * data.moments[0] + background * data.moments[1])
    return min(np.sqrt(spread) / (signal * data.curvature), data.num_bins)


def _is_new(data, known, point) -> bool:
    """Whether a point is a surface beside the known ones [k, FIELDS] of its pixel."""
    apart = np.abs(wrap(known[:, DEPTH] - point[DEPTH], data.num_bins)) > APART * data.resolution_bins
    return bool((apart | (known[:, INTENSITY] == 0)).all() and point[INTENSITY] > FAINTEST * known[0, INTENSITY])


def drop_weak(state, weak):
    state[:, :, INTENSITY][state[:, :, SCORE] < weak] = 0


def leave(data, state, layer, scratch=None):
    m = len(data.energy)
    out = np.zeros(data.matched.shape)
    rest = unexplained(data, state.astype(np.float64))
    for i, j in np.argwhere(data.exposure > 0):
        z = pixel_z(data.matched, i, j)
        for k in range(state.shape[1]):
            if k != layer and state[i, k, INTENSITY, j] > 0:
                depth = state[i, k, DEPTH, j]
                own = max(response_of(rest[i, j, k], depth, data) / data.total_energy, 0)
                z = z - expected(own, depth, data)
        out[i, :m, j], out[i, m:, j] = z.real, z.imag
    return out


__all__ = ["MARGIN", "angular", "blur", "drop_weak", "leave", "match", "prepare", "search"]
