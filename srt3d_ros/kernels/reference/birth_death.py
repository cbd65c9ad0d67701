"""Creation, competition and removal of points: `birth_death` of `kernels.api`."""

from types import SimpleNamespace

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SCORE, STD
from srt3d_ros.kernels.reference.arithmetic import (
    agreement,
    expected,
    has_depth,
    near,
    pixel_z,
    plane_depth,
    response_of,
    wrap,
)
from srt3d_ros.kernels.reference.likelihood import left, llr, log_likelihood_ratio


def birth_death(frame, state, terms, max_chi2, scratch=None):
    state = state.astype(np.float64)
    own, changed = log_likelihood_ratio(frame, state, terms), None
    for _ in range(1 + SPREAD):
        state, own, changed = _chosen_anew(frame, state, own, max_chi2, changed)
    return state


def _chosen_anew(frame, state, own, max_chi2, changed_before) -> tuple:
    """The next state, the ratios of its points, and which pixels changed; every pixel chooses from the state before."""
    after, own_after, changed = state.copy(), own.copy(), np.zeros(frame.exposure.shape, bool)
    for i, j in np.argwhere(frame.exposure > 0):
        had = has_depth(state[i, :, :, j], frame.num_bins).sum()
        if changed_before is not None and (had == state.shape[1] or not _around(changed_before, i, j).any()):
            continue
        around = _candidates(i, j, state, own, frame, max_chi2)
        if not around.near.any() if had == 0 else _settled(around, had):
            continue
        rest, photons = pixel_z(frame.matched, i, j), float(frame.counts[i, j])
        for k in range(state.shape[1]):
            blank, dark = (0 if had else constants.EMPTY_PENALTY * weight for weight in (around.blank, around.dark))
            least = -np.inf if had and k == 0 else constants.BIRTH + blank
            best = _best(k, least, dark, around, rest, photons, frame.exposure[i, j], frame)
            if best is None:
                changed[i, j] |= state[i, k, INTENSITY, j] > 0
                after[i, k, INTENSITY, j] = 0
                continue
            after[i, k, :, j] = _joined(best, around, frame)
            changed[i, j] |= len(best.mine) == 0 or around.surface[best.mine[0]] != k
            own_after[i, k, j] = best.ratio
            around.free &= ~best.agree
            gives = max(response_of(rest, best.at, frame), 0) / frame.total_energy
            rest, photons = rest - expected(gives, best.at, frame), left(photons, gives)
    return after, own_after, changed


def _around(values, i, j) -> np.ndarray:
    """The values of a map within VOTE_RADIUS of pixel (i, j)."""
    return values[i - VOTE_RADIUS:i + VOTE_RADIUS + 1, j - VOTE_RADIUS:j + VOTE_RADIUS + 1]


def _candidates(i, j, state, own, frame, max_chi2) -> SimpleNamespace:
    """The surfaces within VOTE_RADIUS of pixel (i, j), carried there along their planes: arrays over the candidates.

    And the weights of the pixels around that have no surface, of those with photons and of those without.
    """
    rows, blank, dark = [], 0.0, 0.0
    for di, dj in np.ndindex(2 * VOTE_RADIUS + 1, 2 * VOTE_RADIUS + 1):
        di, dj = di - VOTE_RADIUS, dj - VOTE_RADIUS
        a, b, weight = i + di, j + dj, near(di, dj, constants.VOTE_SIGMA)
        lit = np.flatnonzero(has_depth(state[a, :, :, b], frame.num_bins))
        if len(lit) == 0 and (di, dj) != (0, 0):
            blank += weight * (frame.counts[a, b] > 0)
            dark += weight * (frame.counts[a, b] <= 0 and frame.exposure[a, b] > 0)
        for k in lit:
            record = state[a, k, :, b]
            vote = weight * np.clip(constants.PRIOR_VOTE + own[a, k, b], 0, constants.MAX_VOTE)
            rows.append((plane_depth(record, -di, -dj), record[STD]**2, weight, vote, len(lit), (di, dj) == (0, 0),
                         max(abs(di), abs(dj)) <= 1, k, record))
    at, variance, weight, vote, count, mine, close_by, surface, record = (
        map(np.array, zip(*rows)) if rows else np.zeros((9, 0)))
    apart = wrap(at - at[:, None], frame.num_bins)                       # [one, other], from one to the other
    variance = max_chi2 * variance + (constants.RESOLVED * frame.resolution_bins)**2
    close = agreement(apart, variance + variance[:, None])
    return SimpleNamespace(at=at, weight=weight, vote=vote, count=count, surface=surface, record=record, apart=apart,
                           close=close, mine=mine.astype(bool), near=close_by.astype(bool),
                           free=np.ones(len(at), bool), blank=blank, dark=dark)


def _settled(around, had) -> bool:
    """Whether all of the 3 × 3 pixels' surfaces are the pixel's own, and none of those with a surface has fewer."""
    near = around.near
    known = (around.close[near][:, around.mine] > 0).any(axis=1) | around.mine[near]
    return bool((known & (around.count[near] >= had)).all())


def _best(k, least, unseen, around, rest, photons, exposure, frame) -> SimpleNamespace | None:
    """The candidate for the pixel's surface k with the highest log-likelihood ratio, if that is more than `least`."""
    best = None
    eligible = np.flatnonzero(around.free & around.near)
    for c in eligible:
        if any(around.close[q, c] > constants.JUDGED for q in eligible[eligible < c]):
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
        votes -= (around.weight * constants.FEWER_PENALTY / around.count)[fewer].sum()
        votes -= unseen * (1 - np.exp(-intensity * exposure))
        likeness = constants.LIKENESS**2 if k > 0 else constants.LIKENESS
        ratio = llr(response_of(rest, at, frame), photons, intensity * exposure, likeness, frame)
        if ratio + votes > least:
            least = ratio + votes
            best = SimpleNamespace(at=at, agree=agree, weight=weight, mine=mine[-1:], ratio=ratio)
    return best


def _joined(best, around, frame) -> np.ndarray:
    """The pixel's own point if it is among those that agree, else their mean."""
    if len(best.mine):
        return around.record[best.mine[0]]
    record = best.weight @ around.record / best.weight.sum()
    record[DEPTH] = best.at % frame.num_bins
    record[SCORE] = 0
    return record
