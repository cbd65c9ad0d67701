"""What `evidence` and `propose` compute, in plain float64 NumPy, one pixel at a time: written to be read."""

from types import SimpleNamespace

import numpy as np

from srt3d_ros.core.layout import ASTRAY, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels.constants import (
    ALONE,
    BELIEF,
    BLANK,
    CREATE,
    DEAD,
    ENOUGH,
    FILL_WINDOW,
    LEFT,
    LIKENESS,
    REACH,
    RESOLVED,
    SAME,
    SHARING,
    VOTES,
)

from .reference_arithmetic import expected, pixel_z, response_of, unexplained, wrap


def nats(response, photons, expected, likeness, data) -> float:
    """Log-likelihood gain of a surface of about `expected` photons over "background alone"."""
    value, n = max(response, 0.0), max(photons, 0.5)
    means = np.linspace(0, data.greatest_response, len(data.rarity))
    improbable_for_background = n * np.interp(value / n, means, data.rarity.astype(float))**2 / 2

    seen = value / data.total_energy
    likely = np.clip(seen, expected / likeness, expected * likeness)
    deviance = likely - seen + (seen * np.log(seen / likely) if seen > 0 else 0)
    by_signal, by_background = likely * data.intensity_moments[0], max(n - likely, 0) * data.intensity_moments[1]
    improbable_for_surface = deviance * by_signal / (by_signal + by_background)

    gain = improbable_for_background - improbable_for_surface
    return max(gain, DEAD) if photons <= 0 else gain


def evidence(data, state):
    state, rest = state.astype(np.float64), unexplained(data, state)
    out = np.zeros((state.shape[0], state.shape[1], state.shape[3]))
    for i, k, j in np.argwhere((state[:, :, INTENSITY] > 0) & (data.exposure[:, None] > 0)):
        gives = state[i, :, INTENSITY, j] * data.exposure[i, j]
        others = gives.sum() - gives[k]
        photons, likeness = _left(data.noise[i, j], others), SHARING if others > 0 else LIKENESS
        out[i, k, j] = nats(response_of(rest[i, j, k], state[i, k, DEPTH, j], data), photons, gives[k], likeness, data)
    return out


def _left(photons, others) -> float:
    """Without those of other surfaces; only a pixel that saw none is dead."""
    return max(photons - others, LEFT) if photons > 0 else 0.0


def propose(data, state, window, gate, spread, scratch=None):
    state = state.astype(np.float64)
    own = evidence(data, state)
    for step in range(1 + spread):
        state, own = _chosen_anew(data, state, own, window, gate, only_empty=step > 0)
    return state


def _chosen_anew(data, state, own, window, gate, only_empty) -> tuple:
    """The next state and the evidence of its points, every pixel's chosen from the same state before."""
    after, own_after = state.copy(), own.copy()
    inside = slice(MARGIN, -MARGIN)
    after[inside, :, WINDOW, inside] = np.maximum(after[inside, :, WINDOW, inside], window)
    for i, j in np.argwhere(data.exposure > 0):
        had = _points(state[i, :, :, j], data).sum()
        if only_empty and had == state.shape[1]:
            continue
        around = _candidates(i, j, state, own, data, gate)
        if around.near.sum() < ENOUGH if had == 0 else _settled(around, had):
            continue
        rest, photons = pixel_z(data.matched, i, j), float(data.noise[i, j])
        for k in range(state.shape[1]):
            least = -np.inf if had and k == 0 else CREATE + (BLANK * around.blank if had == 0 else 0)
            best = _best(k, least, around, rest, photons, data.exposure[i, j], data)
            if best is None:
                after[i, k, INTENSITY, j] = 0
                continue
            after[i, k, :, j] = _joined(best, around, window, had, data)
            own_after[i, k, j] = best.photonic
            around.free &= ~best.agree
            gives = max(response_of(rest, best.at, data), 0) / data.total_energy
            rest, photons = rest - expected(gives, best.at, data), _left(photons, gives)
    return after, own_after


def _candidates(i, j, state, own, data, gate) -> SimpleNamespace:
    """The surfaces within REACH of pixel (i, j), carried there along their planes: arrays over the candidates.

    And the weight of the pixels around that see photons, but no surface.
    """
    rows, blank = [], 0.0
    for di, dj in np.ndindex(2 * REACH + 1, 2 * REACH + 1):
        di, dj = di - REACH, dj - REACH
        a, b, weight = i + di, j + dj, np.exp(-(di**2 + dj**2) / (2 * 1.2**2))
        lit = np.flatnonzero(_points(state[a, :, :, b], data))
        if len(lit) == 0 and data.noise[a, b] > 0 and (di, dj) != (0, 0):
            blank += weight
        for k in lit:
            record = state[a, k, :, b]
            at = record[DEPTH] - record[SLOPE_COL] * dj - record[SLOPE_ROW] * di
            vote = weight * np.clip(BELIEF + own[a, k, b], *VOTES)
            rows.append((at, record[STD]**2, weight, vote, len(lit), (di, dj) == (0, 0), max(abs(di), abs(dj)) <= 1,
                         record))
    at, variance, weight, vote, count, mine, near, record = map(np.array, zip(*rows)) if rows else np.zeros((8, 0))
    apart = wrap(at - at[:, None], data.num_bins)                       # [one, other], from one to the other
    variance = gate * variance + (RESOLVED * data.resolution_bins)**2
    close = np.maximum(1 - apart**2 / (variance + variance[:, None]), 0)
    return SimpleNamespace(at=at, weight=weight, vote=vote, count=count, mine=mine.astype(bool), record=record,
                           near=near.astype(bool), free=np.ones(len(at), bool), apart=apart, close=close, blank=blank)


def _points(records, data) -> np.ndarray:
    """Which of a pixel's surfaces are there, at depths that mean anything."""
    return (records[:, INTENSITY] > 0) & (records[:, STD] < ASTRAY * data.num_bins)


def _settled(around, had) -> bool:
    """Whether all of the 3 × 3 pixels' surfaces are the pixel's own, and none of those with a surface has fewer."""
    near = around.near
    known = (around.close[near][:, around.mine] > 0).any(axis=1) | around.mine[near]
    return bool((known & (around.count[near] >= had)).all())


def _best(k, least, around, rest, photons, exposure, data) -> SimpleNamespace | None:
    """The candidate for the pixel's surface k with the most evidence, if that is more than `least`."""
    best = None
    eligible = np.flatnonzero(around.free & around.near)
    for c in eligible:
        if any(around.close[q, c] > SAME for q in eligible[eligible < c]):
            continue                                                    # judged as one with a candidate before
        agree = around.free & (around.close[c] > 0)
        weight = around.weight * around.close[c] * agree
        mine = np.flatnonzero(agree & around.mine)
        at = around.at[c] + (weight * around.apart[c]).sum() / weight.sum()
        intensity = (weight * around.record[:, INTENSITY]).sum() / weight.sum()
        if len(mine):
            at, intensity = around.at[mine[-1]], around.record[mine[-1], INTENSITY]
        fewer = ~around.mine & (around.count <= k) if k > 0 else np.zeros(len(agree), bool)
        votes = (around.vote * around.close[c])[agree & ~around.mine & ~fewer].sum()
        votes -= (around.weight * ALONE / around.count)[fewer].sum()
        likeness = SHARING if k > 0 else LIKENESS
        photonic = nats(response_of(rest, at, data), photons, intensity * exposure, likeness, data)
        if photonic + votes > least and (len(mine) or agree.sum() >= ENOUGH):
            least = photonic + votes
            best = SimpleNamespace(at=at, agree=agree, weight=weight, mine=mine[-1:], photonic=photonic)
    return best


def _joined(best, around, window, had, data) -> np.ndarray:
    """The pixel's own point if it is among those that agree, else their mean."""
    if len(best.mine):
        record = around.record[best.mine[0]].copy()
        record[WINDOW] = max(record[WINDOW], window)
        return record
    record = best.weight @ around.record / best.weight.sum()
    record[DEPTH] = best.at % data.num_bins
    record[WINDOW] = window if had else max(window, FILL_WINDOW)
    record[SCORE] = 0
    return record
