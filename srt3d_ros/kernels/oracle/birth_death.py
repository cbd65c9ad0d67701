"""Creation, competition and removal of points: `birth_death`.

Images are the last axes. Before them: V, the surfaces around a pixel, which vote, in the order of their places; C,
those of its 3 × 3 neighbourhood, among which it chooses.
"""

from functools import partial
from types import SimpleNamespace

import numpy as np
import torch

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import SPREAD, TINY, VOTE, VOTE_RADIUS
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.oracle.arithmetic import agreement, as_complex, has_depth, waves, wrap
from srt3d_ros.kernels.oracle.blur import blur
from srt3d_ros.kernels.oracle.likelihood import llr, log_likelihood_ratio
from srt3d_ros.kernels.oracle.windows import by_rows, images, inner, neighbours, square

PAIRS = 8               # numbers that a block holds for each pair of a candidate and a voter, about
SIDE = 2 * VOTE_RADIUS + 1
AROUND = np.ones(SIDE, np.float32)


def birth_death(frame, state, terms, max_chi2):
    """Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood, or none.

    Candidates are the surfaces q of the neighbourhood (VOTE_RADIUS), carried along their planes: t_q − slopes ·
    offset. Two agree by a = (1 − e² / (v_q + v_c))₊, e = wrap(t_q − t_c), v = max_chi2 · std² + δ².
    The pixel's surface k is the candidate c of its 3 × 3 neighbourhood with the highest

        ratio of the pixel's photons + Σ_q w_q a_qc clip(VOTE + ratio_q, 0, MAX_VOTES · VOTE)
            − Σ_q w_q VOTE / count_q

    (see `log_likelihood_ratio`), w = exp(−distance² / 2 VOTE_SIGMA²). The last sum, for k > 0, is over the surfaces
    of neighbours that have no more than k, whose votes do not count: a pixel that truly sees two surfaces keeps
    both, and edges show no double points. A candidate needs VOTE, unless it is for the first surface of a pixel
    that has one; in a pixel without surfaces, EMPTY_VOTES · VOTE · w more for each used neighbour without a surface, of
    those without photons times 1 − exp(−g r), the probability that it would show there. The pixel keeps its own point
    if that agrees with the best, else it takes the mean of what agrees, weighted by w a, with score 0. What agrees and
    the photons it explains are left out for the next k. Points with a standard deviation above MAX_STD · T count as
    none. Pixels stay as they are where their 3 × 3 neighbourhood agrees with them already.

    Then SPREAD more times, for pixels with fewer than K surfaces of whose neighbourhood the time before has
    changed: surfaces so grow by as many pixels.

    Returns the next state, which may take the place of `state`. `max_chi2` is the square of the standard deviations
    within which depths may be one surface's.
    """
    state, own = state.clone(), log_likelihood_ratio(frame, state, terms)
    surfaces, row_bytes = state.shape[1], PAIRS * 9 * SIDE**2 * state.shape[1]**2 * state[0, 0, 0].nbytes
    may_choose = frame.exposure > 0
    for _ in range(1 + SPREAD):
        points, ratios, changed = by_rows(partial(_chosen_anew, max_chi2), row_bytes, frame, state, own, may_choose)
        inner(state)[:], inner(own)[:] = points, ratios
        near_change = blur(changed[:, None].to(state.dtype), AROUND)[:, 0] > 0.5
        may_choose = torch.zeros_like(may_choose)
        has_room = has_depth(inner(state).movedim(2, 0), frame.num_bins).sum(1) < surfaces
        inner(may_choose)[:] = near_change & has_room & (inner(frame.exposure) > 0)
    return state


def _chosen_anew(max_chi2, frame, state, own, may_choose) -> tuple:
    """Rows of the next state, of its points' ratios, and which pixels changed: all choose from the state before."""
    points, ratios = images(inner(state)).clone(), images(inner(own)).clone()
    before, around = points.clone(), _around(frame, state, own, max_chi2)
    chooses = inner(may_choose) & around.undecided
    rest, photons, light = as_complex(inner(frame.matched)), inner(frame.counts), inner(frame.exposure)
    changed = torch.zeros_like(chooses)
    for k in range(len(points)):
        best = _best(k, around, before, rest, photons, light, frame)
        found = chooses & best.found
        points[k] = torch.where(found, best.point, points[k])
        points[k, INTENSITY] = torch.where(chooses & ~found, 0, points[k, INTENSITY])
        ratios[k] = torch.where(found, best.ratio, ratios[k])
        changed |= chooses & torch.where(found, best.own != k, before[k, INTENSITY] > 0)
        around.free &= ~(best.agree & found)
        gives = torch.where(found, best.response.clamp(min=0) / frame.total_energy, 0)
        rest = rest - gives[:, None] * frame.energy[:, None] * waves(frame, best.depth)
        photons = torch.where(photons > 0, (photons - gives).clamp(min=0.5), 0)
    return *(values.movedim(-2, 0) for values in (points, ratios)), changed


def _close_by(voters, axis: int = 0):
    """The candidates among the voters along an axis."""
    places = voters.unflatten(axis, (SIDE, SIDE, -1)).narrow(axis, VOTE_RADIUS - 1, 3)
    return places.narrow(axis + 1, VOTE_RADIUS - 1, 3).flatten(axis, axis + 2)


def _around(frame, state, own, max_chi2) -> SimpleNamespace:
    """The voters of each pixel, carried there along their planes, and how each candidate agrees with them."""
    period, surfaces = frame.num_bins, state.shape[1]
    places = square(VOTE_RADIUS, state.dtype, state.device)
    dy, dx, centre = places.dy, places.dx, len(places.dy) // 2
    record = neighbours(state, places)                                          # [N, K, FIELDS, rows, cols]
    weight = torch.exp(-(dy**2 + dx**2) / (2 * constants.NEAR_SIGMA**2))
    there = has_depth(record.movedim(2, 0), period)
    count = there.sum(1)
    vote = (VOTE + neighbours(own, places)).clamp(0, constants.MAX_VOTES * VOTE) * weight[:, None]
    at = record[:, :, DEPTH] - record[:, :, SLOPE_COL] * dx[:, None] - record[:, :, SLOPE_ROW] * dy[:, None]
    tolerance = max_chi2 * record[:, :, STD]**2 + frame.resolution_bins**2
    at, tolerance, vote, there, record = (values.flatten(0, 1) for values in (at, tolerance, vote, there, record))
    apart = wrap(at - _close_by(at)[:, None], period)                           # [C, V, rows, cols]
    close = agreement(apart, tolerance + _close_by(tolerance)[:, None])
    middle = slice(centre * surfaces, (centre + 1) * surfaces)
    other = torch.ones(len(at), 1, 1, dtype=torch.bool, device=at.device)
    other[middle] = False
    around = SimpleNamespace(
        at=at, vote=vote, there=there, record=record, close=close, lean=close * apart, middle=middle, other=other,
        weight=weight.repeat_interleave(surfaces, 0), count=count.repeat_interleave(surfaces, 0), free=there.clone(),
        had=count[centre])
    _add_gaps(around, frame, count, weight, places)
    _add_undecided(around)
    return around


def _add_gaps(around, frame, count, weight, places) -> None:
    """What a first surface of a pixel needs more, and loses where dark: by the pixels around that have none."""
    counts, exposure = (neighbours(values, places) for values in (frame.counts, frame.exposure))
    gap = weight * ((count == 0) & (around.had == 0)) * constants.EMPTY_VOTES * VOTE
    gap[len(gap) // 2] = 0
    around.blank = (gap * (counts > 0)).sum(0)
    around.dark = (gap * ((counts <= 0) & (exposure > 0))).sum(0)


def _add_undecided(around) -> None:
    """Where a candidate is not the pixel's, or of a pixel with fewer; where there is one, if the pixel has none."""
    known = (around.close[:, around.middle] * around.there[around.middle]).amax(1) > 0
    there, fewer = _close_by(around.there), _close_by(around.count) < around.had
    around.undecided = torch.where(around.had > 0, (there & (~known | fewer)).any(0), there.any(0))


def _best(k, around, before, rest, photons, light, frame) -> SimpleNamespace:
    """The candidate for the pixels' surface k with the highest log-likelihood ratio, and whether that is enough.

    Returns:
        found, point (the pixel's own, or the mean of what agrees), own (which of its own, or −1), agree (voters, with
        the candidate), depth, ratio and response of the pixel's photons.
    """
    free, close = around.free, around.close
    weight = around.weight * free
    total = (close * weight).sum(1).clamp(min=TINY)
    depth = _close_by(around.at) + (around.lean * weight).sum(1) / total
    intensity = (close * (weight * around.record[:, INTENSITY])).sum(1) / total
    number = torch.arange(1, len(before) + 1, device=free.device)[:, None, None]
    own = ((close[:, around.middle] > 0) * (free[around.middle] * number)).amax(1) - 1
    has_own, one = own >= 0, own.clamp(min=0)
    depth = torch.where(has_own, before[:, DEPTH].gather(0, one), depth)
    intensity = torch.where(has_own, before[:, INTENSITY].gather(0, one), intensity)

    score, ratio, response = _scores(k, around, depth, intensity, rest, photons, light, frame)
    best = score.argmax(0, keepdim=True)
    score, ratio, response, depth, own = (values.gather(0, best)[0] for values in (score, ratio, response, depth, own))
    least = VOTE + around.blank
    least = least.masked_fill(around.had > 0, -torch.inf) if k == 0 else least
    close = close.gather(0, best[:, None].expand(1, *close.shape[1:]))[0]
    weight = weight * close
    point = (weight[:, None] * around.record).sum(0) / weight.sum(0).clamp(min=TINY)
    point[DEPTH], point[SCORE] = depth % frame.num_bins, 0
    kept = before.gather(0, own.clamp(min=0).expand(1, *before.shape[1:]))[0]
    return SimpleNamespace(found=score > least, point=torch.where(own >= 0, kept, point), own=own, agree=close > 0,
                           depth=depth, ratio=ratio, response=response)


def _scores(k, around, depth, intensity, rest, photons, light, frame) -> tuple:
    """Of each candidate as surface k: score (−∞ if not to be judged), and ratio and response of the pixels' photons."""
    votes, free = around.vote * (around.free & around.other), _close_by(around.free)
    against = around.dark * (1 - torch.exp(-intensity * light))
    if k > 0:
        fewer = around.there & around.other & (around.count <= k)
        votes = votes * ~fewer
        against = against + (around.weight * VOTE / around.count.clamp(min=1) * fewer).sum(0)
    response = (rest * waves(frame, depth).conj()).real.sum(2)
    likeness = constants.LIKENESS**2 if k > 0 else constants.LIKENESS
    ratio = llr(response, photons.expand_as(response), intensity * light, likeness, frame)
    score = ratio + (around.close * votes).sum(1) - against
    return score.masked_fill(~free, -torch.inf), ratio, response
