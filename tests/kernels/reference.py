"""What the kernels compute, in plain float64 NumPy, one pixel at a time: written to be read, not to be fast.

The functions have the kernels' names, arguments and results, so that Pooled runs on them too. A pixel's statistics are
complex numbers z_l here, of which the kernels keep real and imaginary parts apart.
"""

import numpy as np

from srt3d_ros.core.layout import ASTRAY, DEPTH, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels.constants import FIT_RADIUS, FITS, RIDGE, STD_FLOOR, STEP

from .reference_arithmetic import angular, response_of, unexplained, wrap
from .reference_propose import evidence, propose
from .reference_settle import collect, settled
from .reference_start import blur, drop_weak, leave, match, prepare, search

__all__ = ["Pipeline", "Scratch", "array", "blur", "collect", "descend", "drop_weak", "evidence", "explain",
           "leave", "match", "numpy", "own_intensity", "prepare", "propose", "relief", "search", "settle",
           "sketch_continuous", "sketch_gates", "sketch_unsorted"]

SLOPES = [SLOPE_COL, SLOPE_ROW]


# ---- Photons → sketch ----------------------------------------------------------------------------------------------

def sketch_continuous(pixel, toa, omegas, pixels):
    sums, photons = np.zeros((pixels, len(omegas)), complex), np.zeros(pixels, int)
    for p, x in zip(pixel, toa.astype(np.float64)):
        sums[p] += np.exp(1j * omegas * x)
        photons[p] += 1
    return sums.view(float), photons


def sketch_unsorted(pixel, toa, table, pixels):
    sums, photons = np.zeros((pixels, table.shape[1])), np.zeros(pixels, int)
    for p, x in zip(pixel, toa):
        sums[p] += table[x]
        photons[p] += 1
    return sums, photons


def sketch_gates(words, table, first_word, no_detection):
    cycle, pixel = np.nonzero(words != no_detection)
    bins = words[cycle, pixel].astype(int) - first_word
    stray = (bins < 0) | (bins >= len(table))
    sums, photons = sketch_unsorted(pixel[~stray], bins[~stray], table, words.shape[1])
    return sums, photons, max(words[cycle, pixel][stray].tolist(), default=-1)


# ---- Iterations ----------------------------------------------------------------------------------------------------

def descend(data, state, radius, gate, steps=3, out=None):
    state = state.astype(np.float64)
    surfaces = state.shape[1]
    after = np.zeros_like(state)
    rest = unexplained(data, state)
    for i, j in np.argwhere((state[:, :, INTENSITY] > 0).any(axis=1)):
        window = np.s_[i - radius:i + radius + 1, :, :, j - radius:j + radius + 1]
        around = state[window].transpose(0, 3, 1, 2)                      # [rows, cols, K, FIELDS]
        sketches = rest[i - radius:i + radius + 1, j - radius:j + radius + 1]         # [rows, cols, K, m]
        noise, exposure = (a[window[0], window[3]].astype(np.float64) for a in (data.noise, data.exposure))
        for k in range(surfaces):
            point = state[i, k, :, j].copy()
            if point[INTENSITY] > 0:
                beyond = max(radius - FIT_RADIUS, 0)
                for _ in range(FITS):
                    point[SLOPES] = _plane(point, _within(around, beyond), gate, data)
                after[i, k, :, j] = _climbed(point, around, sketches, noise, exposure, radius, gate, steps, data)
    if out is None:
        return after
    out[:] = after
    return out


def _within(around, margin) -> np.ndarray:
    """A window less `margin` pixels on each side."""
    return around[margin:len(around) - margin, margin:len(around) - margin]


def _weighed(point, around, gate, data, limit=np.inf) -> tuple:
    """How much the surfaces of a window count for a point [rows, cols, K], how much pixels without any [rows, cols].

    And the distance of each surface from the point's plane, in bins. Beyond √limit pixels nothing counts.
    """
    depth, std, seen = around[..., DEPTH], around[..., STD], around[..., INTENSITY] > 0
    dy, dx = _offsets(around)
    near = np.exp(-(dx**2 + dy**2) / (2 * max(point[WINDOW], 0.1)**2))
    near = np.where(dx**2 + dy**2 <= limit, near, 0)
    plane = point[DEPTH] + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    e = wrap(depth - plane[..., None], data.num_bins)
    close = np.maximum(1 - e**2 / (gate * point[STD]**2 + gate * std**2 + 1e-12), 0)
    nearest = seen & (np.abs(e) <= np.where(seen, np.abs(e), np.inf).min(axis=2, keepdims=True))
    return np.where(nearest, near[..., None] * close**2, 0), np.where(seen.any(axis=2), 0, near), e


def _plane(point, around, gate, data) -> np.ndarray:
    """Slopes of the least-squares plane through the surfaces of a window, each weighed by its variance."""
    w, _, e = _weighed(point, around, gate, data)
    dy, dx = (np.broadcast_to(d[..., None], w.shape) for d in _offsets(around))
    f = w / (around[..., STD]**2 + STD_FLOOR)
    total = f.sum() + 1e-12
    rise = e + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    centred = [d - (f * d).sum() / total for d in (dx, dy, rise)]
    x, y, rise = centred
    spread = np.array([[(f * a * b).sum() for a in (x, y)] for b in (x, y)]) / total
    steepness = data.curvature / data.total_energy
    spread += np.eye(2) * (steepness / total + RIDGE)
    return np.linalg.solve(spread, [(f * x * rise).sum() / total, (f * y * rise).sum() / total])


def _climbed(point, around, sketches, noise, exposure, radius, gate, steps, data) -> np.ndarray:
    """The point after gradient steps on the sketches of its window, added up along its plane."""
    w, blank, _ = _weighed(point, around, gate, data, radius * (radius + 1))
    dy, dx = _offsets(around)
    plane = point[DEPTH] + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    w[..., 0] += blank                                  # a pixel without surfaces shows all it has
    omega, total = angular(data), data.total_energy
    pooled = np.einsum("abk,abkl,abl->l", w, sketches, np.exp(-1j * plane[..., None] * omega))
    noise_sum = (w**2 * noise[..., None]).sum()
    photons, exposure_sum = (w * noise[..., None]).sum(), (w * exposure[..., None]).sum()

    d = 0.0
    for _ in range(steps):
        along = pooled * np.exp(-1j * omega * d)
        least = 0.5 * max(along.real.sum(), 0) / total * data.curvature
        step = (omega * along.imag).sum() / (max((omega**2 * along.real).sum(), least) + 1e-12)
        d += np.clip(step, -data.resolution_bins, data.resolution_bins)
    value = (pooled * np.exp(-1j * omega * d)).real.sum()

    out = point.copy()
    strength = max(value, 0) / total
    signal = min(strength, photons)
    variance = (signal * data.moments[0] + (photons - signal) * data.moments[1]) * noise_sum / max(photons, 1e-12)
    out[DEPTH] = (point[DEPTH] + d) % data.num_bins
    out[INTENSITY] = max(strength / max(exposure_sum, 1e-12), 1e-12)
    out[STD] = data.num_bins
    if signal > 0:
        out[STD] = min(np.sqrt(variance) / max(signal * data.curvature, 1e-12), data.num_bins)
    score = value / np.sqrt(noise_sum * total / 2 + 1e-12)
    out[SCORE] = max(score, point[SCORE]) if 1.5 * point[WINDOW] > radius else score
    return out


def explain(data, state):
    z = unexplained(data, state)
    return np.concatenate([z.real, z.imag], axis=3).transpose(2, 0, 3, 1)


def own_intensity(data, state):
    state = state.astype(np.float64)
    rest = unexplained(data, state)
    out = np.zeros((state.shape[0], state.shape[1], state.shape[3]))
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        value = response_of(rest[i, j, k], state[i, k, DEPTH, j], data)
        out[i, k, j] = value / (data.total_energy * max(data.exposure[i, j], 1e-12))
    return out


def relief(state, window, radius, gate, num_bins):
    state = state.astype(np.float64)
    out = np.zeros((state.shape[0], state.shape[1], state.shape[3]))
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        point = state[i, k, :, j]
        around = state[i - radius:i + radius + 1, :, :, j - radius:j + radius + 1].transpose(0, 3, 1, 2)
        dy, dx = _offsets(around)
        near = np.exp(-(dx**2 + dy**2) / (2 * window**2))
        near *= (dx % STEP == 0) & (dy % STEP == 0) & ((dx != 0) | (dy != 0))
        plane = point[DEPTH] + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
        e = wrap(around[..., DEPTH] - plane[..., None], num_bins)
        close = np.maximum(1 - e**2 / (gate * (around[..., STD]**2 + point[STD]**2) + 1e-12), 0)
        w = near[..., None] * close**2 * (around[..., INTENSITY] > 0) * (around[..., STD] < ASTRAY * num_bins)
        out[i, k, j] = np.sqrt((w * e**2).sum() / (w.sum() + 1e-12))
    return out


def _offsets(around) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a window's pixels from its centre."""
    radius = around.shape[0] // 2
    return np.mgrid[-radius:radius + 1, -radius:radius + 1].astype(np.float64)


# ---- End -----------------------------------------------------------------------------------------------------------

def settle(data, photons, state, enough, window, radius, gate, scratch=None):
    return settled(data, photons, state, own_intensity(data, state), relief(state, window, radius, gate, data.num_bins),
                   enough)


# ---- Memory --------------------------------------------------------------------------------------------------------

class Scratch:
    def array(self, name, shape, zero=False):
        return np.zeros(shape)


def array(values):
    return values


numpy = array


class Pipeline:
    def __init__(self, function, replays=True):
        self.submit = lambda *frame: lambda: function(*frame)
