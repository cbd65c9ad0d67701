"""What the kernels compute, in plain float64 NumPy, one pixel at a time: written to be read, not to be fast.

The functions have the kernels' names, arguments and results, so that SRT3D runs on them too. A pixel's statistics are
complex numbers z_l here, of which the kernels keep real and imaginary parts apart.
"""

import numpy as np

from srt3d_ros.core.layout import DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels.cpu.descend import FIT_RADIUS, FITS, RIDGE, STD_FLOOR
from srt3d_ros.kernels.cpu.propose import ENOUGH, FILL_WINDOW, PRIOR

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


# ---- Start ---------------------------------------------------------------------------------------------------------

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
        rest = _z(matched, i, j)
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


# ---- Iterations ----------------------------------------------------------------------------------------------------

def propose(data, state, window, gate):
    state = state.astype(np.float64)
    after = state.copy()
    inside = slice(MARGIN, -MARGIN)
    after[inside, :, WINDOW, inside] = np.maximum(after[inside, :, WINDOW, inside], window)
    for i, j in np.argwhere(data.exposure > 0):
        candidates = _carried(i, j, state, data, gate)
        own = sum(c["own"] for c in candidates)
        differ = any(_apart(c, candidates[0], data) > 1 for c in candidates)
        if (own and not differ) or (not own and len(candidates) < ENOUGH):
            continue
        rest = _z(data.matched, i, j)
        for k in range(state.shape[1]):
            chosen = _strongest(candidates, 1 if k == 0 else ENOUGH, rest, data.noise[i, j], data)
            if chosen is None:
                after[i, k, INTENSITY, j] = 0
                continue
            record = _joined(chosen, candidates, data)
            if chosen["mine"]:
                record = chosen["mine"]["record"].copy()
                record[WINDOW] = max(record[WINDOW], window)
            else:
                record[WINDOW] = window if own else max(window, FILL_WINDOW)
            after[i, k, :, j] = record
            rest = rest - data.exposure[i, j] * _expected(record, data)
    return after


def _carried(i, j, state, data, gate) -> list[dict]:
    """The surfaces of the 3 × 3 neighbourhood, carried to pixel (i, j) along their planes."""
    out = []
    for di, dj in np.ndindex(3, 3):
        di, dj = di - 1, dj - 1
        for record in state[i + di, :, :, j + dj]:
            if record[INTENSITY] > 0:
                out.append({"record": record, "t": record[DEPTH] - record[SLOPE_COL] * dj - record[SLOPE_ROW] * di,
                            "v": gate * record[STD]**2 + (2 * data.resolution_bins)**2, "free": True,
                            "w": np.exp(-(di**2 + dj**2) / (2 * 1.2**2)), "own": di == 0 and dj == 0})
    return out


def _apart(one, other, data) -> float:
    """Squared distance of two candidates in units of what makes them two surfaces."""
    return _wrap(one["t"] - other["t"], data.num_bins)**2 / (one["v"] + other["v"])


def _strongest(candidates, enough, rest, noise, data) -> dict | None:
    """The free candidate with the most evidence: what the pixel's own photons gain, plus the neighbours' votes."""
    best = None
    for c in (c for c in candidates if c["free"]):
        agree = [q for q in candidates if q["free"] and _apart(q, c, data) < 1]
        votes = np.array([q["w"] * (1 - _apart(q, c, data)) for q in agree])
        shift = sum(vote * _wrap(q["t"] - c["t"], data.num_bins) for vote, q in zip(votes, agree)) / votes.sum()
        mine = next((q for q in reversed(agree) if q["own"]), None)
        at = mine["t"] if mine else c["t"] + shift
        value = max((rest * np.exp(-1j * _omega(data) * at)).real.sum(), 0)
        evidence = value**2 / (data.total_energy * max(noise, 1)) + PRIOR * votes.sum()
        if len(agree) >= enough and (best is None or evidence > best["evidence"]):
            best = {"evidence": evidence, "at": at, "mine": mine, "agree": agree, "votes": votes}
    return best


def _joined(chosen, candidates, data) -> np.ndarray:
    """The mean of the candidates that agree, which are spent."""
    for q in chosen["agree"]:
        q["free"] = False
    record = sum(vote * q["record"] for vote, q in zip(chosen["votes"], chosen["agree"])) / chosen["votes"].sum()
    record[DEPTH] = chosen["at"] % data.num_bins
    return record


def descend(data, state, radius, gate, steps=3):
    state = state.astype(np.float64)
    surfaces = state.shape[1]
    after = np.zeros_like(state)
    rest = _unexplained(data, state)
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
    return after


def _within(around, margin) -> np.ndarray:
    """A window less `margin` pixels on each side."""
    return around[margin:len(around) - margin, margin:len(around) - margin]


def _weighed(point, around, gate, data) -> tuple:
    """How much the surfaces of a window count for a point [rows, cols, K], how much pixels without any [rows, cols].

    And the distance of each surface from the point's plane, in bins.
    """
    depth, std, seen = around[..., DEPTH], around[..., STD], around[..., INTENSITY] > 0
    dy, dx = _offsets(around)
    near = np.exp(-(dx**2 + dy**2) / (2 * max(point[WINDOW], 0.1)**2))
    plane = point[DEPTH] + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    e = _wrap(depth - plane[..., None], data.num_bins)
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
    w, blank, _ = _weighed(point, around, gate, data)
    dy, dx = _offsets(around)
    plane = point[DEPTH] + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    w[..., 0] += blank                                  # a pixel without surfaces shows all it has
    omega, total = _omega(data), data.total_energy
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
    out[SCORE] = max(score, point[SCORE]) if 2 * point[WINDOW] > radius else score
    return out


def own_intensity(data, state):
    state = state.astype(np.float64)
    rest = _unexplained(data, state)
    out = np.zeros((state.shape[0], state.shape[1], state.shape[3]))
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        value = (rest[i, j, k] * np.exp(-1j * _omega(data) * state[i, k, DEPTH, j])).real.sum()
        out[i, k, j] = value / (data.total_energy * max(data.exposure[i, j], 1e-12))
    return out


def _unexplained(data, state) -> np.ndarray:
    """What each surface of a pixel sees of its photons: all but what the other surfaces explain, [rows, cols, K, m]."""
    tall, surfaces, _, wide = state.shape
    out = np.zeros((tall, wide, surfaces, len(data.energy)), complex)
    for i, j in np.ndindex(tall, wide):
        explained = [data.exposure[i, j] * _expected(record, data) for record in state[i, :, :, j]]
        for k in range(surfaces):
            out[i, j, k] = _z(data.matched, i, j) - sum(explained[o] for o in range(surfaces) if o != k)
    return out


def _expected(record, data) -> np.ndarray:
    """What a surface adds to a pixel of exposure 1: r |ĥ|² exp(i ω t)."""
    return record[INTENSITY] * data.energy * np.exp(1j * _omega(data) * record[DEPTH])


def _z(matched, i, j) -> np.ndarray:
    m = matched.shape[1] // 2
    return matched[i, :m, j].astype(np.float64) + 1j * matched[i, m:, j]


def _omega(data) -> np.ndarray:
    return 2 * np.pi * data.cycles.astype(np.float64)


def _offsets(around) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a window's pixels from its centre."""
    radius = around.shape[0] // 2
    return np.mgrid[-radius:radius + 1, -radius:radius + 1].astype(np.float64)


def _wrap(difference, period):
    return difference - period * np.rint(difference / period)
