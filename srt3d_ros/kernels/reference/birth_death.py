"""Creation, competition and removal of points: `birth_death`."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import torch

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SCORE, STD
from srt3d_ros.kernels.reference import likelihood
from srt3d_ros.kernels.reference.arithmetic import agreement, has_depth, near, plane_depth, wrap
from srt3d_ros.kernels.reference.arrays import in_numpy


def birth_death(frame, state, terms, max_chi2, scratch=None):
    """Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood, or none.

    Candidates are the surfaces q of the neighbourhood (VOTE_RADIUS), carried along their planes: t_q − slopes ·
    offset. Two agree by a = (1 − e² / (v_q + v_c))₊, e = wrap(t_q − t_c), v = max_chi2 · std² + (RESOLVED · δ)².
    The pixel's surface k is the candidate c of its 3 × 3 neighbourhood with the highest

        ratio of the pixel's photons + Σ_q w_q a_qc clip(PRIOR_VOTE + ratio_q, 0, MAX_VOTE)
            − Σ_q w_q FEWER_PENALTY / count_q

    (see `log_likelihood_ratio`), w = exp(−distance² / 2 VOTE_SIGMA²). The last sum, for k > 0, is over the surfaces
    of neighbours that have no more than k, whose votes do not count: a pixel that truly sees two surfaces keeps
    both, and edges show no double points. A candidate needs BIRTH, unless it is for the first surface of a pixel
    that has one; in a pixel without surfaces, EMPTY_PENALTY · w more for each used neighbour without a surface, of
    those without photons times 1 − exp(−g r), the probability that it would show there. Candidates that agree by
    more than JUDGED with one before are not judged again. The pixel keeps its own point if that
    agrees with the best, else it takes the mean of what agrees, weighted by w a, with score 0. What agrees and the
    photons it explains are left out for the next k. Points with a standard deviation above MAX_STD · T count as
    none. Pixels stay as they are where their 3 × 3 neighbourhood agrees with them already.

    Then SPREAD more times, for pixels with fewer than K surfaces of whose neighbourhood the time before has
    changed: surfaces so grow by as many pixels.

    Returns the next state. `max_chi2` is the square of the standard deviations within which depths may be one
    surface's.
    """
    own, changed = likelihood.log_likelihood_ratio(frame, state, terms), None
    for _ in range(1 + SPREAD):
        state, own, changed = _chosen_anew(frame, state, own, max_chi2, changed, partial(likelihood.llr, frame=frame))
    return state


@in_numpy
def _chosen_anew(frame, state, own, max_chi2, changed_before, judge) -> tuple:
    """The next state, the ratios of its points, and which pixels changed; every pixel chooses from the state before."""
    after, own_after, changed = state.copy(), own.copy(), np.zeros(frame.exposure.shape, bool)
    m, omega = len(frame.energy), 2 * np.pi * frame.bin_frequencies
    for i, j in np.argwhere(frame.exposure > 0):
        had = has_depth(state[i, :, :, j], frame.num_bins).sum()
        if changed_before is not None and (had == state.shape[1] or not _around(changed_before, i, j).any()):
            continue
        around = _candidates(i, j, state, own, frame, max_chi2)
        if not around.near.any() if had == 0 else _settled(around, had):
            continue
        rest, photons = frame.matched[i, :m, j] + 1j * frame.matched[i, m:, j], frame.counts[i, j]
        for k in range(state.shape[1]):
            blank, dark = (0 if had else constants.EMPTY_PENALTY * weight for weight in (around.blank, around.dark))
            least = -np.inf if had and k == 0 else constants.BIRTH + blank
            best = _best(k, least, dark, around, rest, photons, frame.exposure[i, j], frame.bin_frequencies, judge)
            if best is None:
                changed[i, j] |= state[i, k, INTENSITY, j] > 0
                after[i, k, INTENSITY, j] = 0
                continue
            after[i, k, :, j] = _joined(best, around, frame)
            changed[i, j] |= len(best.mine) == 0 or around.surface[best.mine[0]] != k
            own_after[i, k, j] = best.ratio
            around.free &= ~best.agree
            gives, phases = max(best.response, 0) / frame.total_energy, np.exp(1j * omega * best.at)
            rest, photons = rest - gives * frame.energy * phases, max(photons - gives, 0.5) if photons > 0 else 0
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


def _best(k, least, unseen, around, rest, photons, exposure, bin_frequencies, judge) -> SimpleNamespace | None:
    """The candidate for the pixel's surface k with the highest log-likelihood ratio, if that is more than `least`."""
    judged, eligible = [], np.flatnonzero(around.free & around.near)
    for c in eligible:
        if any(around.close[q, c] > constants.JUDGED for q in eligible[eligible < c]):
            continue                                                    # judged as one with a candidate before
        agree = around.free & (around.close[c] > 0)
        weight = around.weight * around.close[c] * agree
        mine = np.flatnonzero(agree & around.mine)[-1:]
        at = around.at[c] + (weight * around.apart[c]).sum() / weight.sum()
        intensity = (weight * around.record[:, INTENSITY]).sum() / weight.sum()
        if len(mine):
            at, intensity = around.at[mine[0]], around.record[mine[0], INTENSITY]
        fewer = ~around.mine & (around.count <= k) if k > 0 else np.zeros(len(agree), bool)
        votes = (around.vote * around.close[c])[agree & ~around.mine & ~fewer].sum()
        votes -= (around.weight * constants.FEWER_PENALTY / around.count)[fewer].sum()
        votes -= unseen * (1 - np.exp(-intensity * exposure))
        response = (rest * np.exp(-2j * np.pi * bin_frequencies * at)).real.sum()
        judged.append(SimpleNamespace(at=at, agree=agree, weight=weight, mine=mine, votes=votes, response=response,
                                      gives=intensity * exposure))
    if not judged:
        return None
    response, gives = (torch.tensor([getattr(each, name) for each in judged]) for name in ("response", "gives"))
    likeness = constants.LIKENESS**2 if k > 0 else constants.LIKENESS
    ratios = judge(response, torch.full_like(response, photons), gives, likeness)
    for each, ratio in zip(judged, ratios.tolist()):
        each.ratio = ratio
    best = max(judged, key=lambda each: each.ratio + each.votes)
    return best if best.ratio + best.votes > least else None


def _joined(best, around, frame) -> np.ndarray:
    """The pixel's own point if it is among those that agree, else their mean."""
    if len(best.mine):
        return around.record[best.mine[0]]
    record = best.weight @ around.record / best.weight.sum()
    record[DEPTH] = best.at % frame.num_bins
    record[SCORE] = 0
    return record
