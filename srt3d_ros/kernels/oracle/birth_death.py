"""Creation, competition and removal of points: `birth_death`.

Images are the last axes. Before them: N, the 3 × 3 pixels around each; V, their surfaces, in that order, which vote and
are the candidates.
"""

from functools import partial
from types import SimpleNamespace

import numpy as np
import torch

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import EMPTY_SHARE, SPREAD, TINY, VOTE
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.oracle.arithmetic import agreement, as_complex, has_depth, waves, wrap
from srt3d_ros.kernels.oracle.blur import blur
from srt3d_ros.kernels.oracle.likelihood import llr
from srt3d_ros.kernels.oracle.windows import by_rows, images, inner, neighbours, square

PAIRS = 8               # numbers that a block holds for each pair of a candidate and a voter, about
MIDDLE = 4              # the pixel itself
AROUND = np.ones(3, np.float32)


def birth_death(frame, state, max_chi2):
    """Birth/death update: each pixel takes the surfaces around it that are most likely, or none.

    Candidates are the surfaces q of the 3 × 3 pixels around, carried along their planes: t_q − slopes · offset. Two
    agree by a = (1 − e² / (v_q + v_c))₊, e = wrap(t_q − t_c), v = max_chi2 · std² + δ². The pixel's surface k is the
    candidate c with the highest

        ratio of the pixel's photons + VOTE (Σ_q a_qc − Σ 1 − Σ EMPTY_SHARE)

    (see `likelihood.llr`), if that is above 0; a pixel that has surfaces takes its first one even if it is not. The
    first sum is over the surfaces of neighbours that have more than k, the second over the neighbours with fewer, the
    third over the used ones without any. So a pixel that truly sees two surfaces keeps both, and edges show no double
    points.

    Photons are expected, and judged, at the mean t and r of what agrees with c, weighted by a, or at those of the
    pixel's own point if it agrees. The pixel keeps that point, else it takes the mean, with score 0. What agrees and
    the photons it explains are left out for the next k. Points with a standard deviation above MAX_STD · T count as
    none. Pixels stay as they are where their neighbourhood agrees with them already.

    Then SPREAD more times, for pixels with fewer than K surfaces beside which the time before has changed something:
    surfaces so grow by as many pixels.

    Returns the next state, which may take the place of `state`. `max_chi2` is the square of the standard deviations
    within which depths may be one surface's.
    """
    state = state.clone()
    row_bytes = PAIRS * 81 * state.shape[1]**2 * state[0, 0, 0].nbytes
    may_choose = frame.exposure > 0
    for _ in range(1 + SPREAD):
        points, changed = by_rows(partial(_chosen_anew, max_chi2), row_bytes, frame, state, may_choose)
        inner(state)[:] = points
        near_change = blur(changed[:, None].to(state.dtype), AROUND)[:, 0] > 0.5
        may_choose = torch.zeros_like(may_choose)
        has_room = has_depth(inner(state).movedim(2, 0), frame.num_bins).sum(1) < state.shape[1]
        inner(may_choose)[:] = near_change & has_room & (inner(frame.exposure) > 0)
    return state


def _chosen_anew(max_chi2, frame, state, may_choose) -> tuple:
    """Rows of the next state, and which pixels changed: all choose from the state before."""
    points = images(inner(state)).clone()
    before, around = points.clone(), _around(frame, state, max_chi2)
    chooses = inner(may_choose) & _undecided(around)
    rest, photons, light = as_complex(inner(frame.matched)), inner(frame.counts), inner(frame.exposure)
    changed = torch.zeros_like(chooses)
    for k in range(len(points)):
        best = _best(k, around, before, rest, photons, light, frame)
        found = chooses & best.found
        points[k] = torch.where(found, best.point, points[k])
        points[k, INTENSITY] = torch.where(chooses & ~found, 0, points[k, INTENSITY])
        changed |= chooses & torch.where(found, best.own != k, before[k, INTENSITY] > 0)
        around.free &= ~(best.agree & found)
        gives = torch.where(found, best.response.clamp(min=0) / frame.total_energy, 0)
        rest = rest - gives[:, None] * frame.energy[:, None] * waves(frame, best.depth)
        photons = torch.where(photons > 0, (photons - gives).clamp(min=0.5), 0)
    return points.movedim(-2, 0), changed


def _around(frame, state, max_chi2) -> SimpleNamespace:
    """The surfaces around each pixel, carried there along their planes, and how they agree with each other."""
    places, surfaces = square(1, state.dtype, state.device), state.shape[1]
    dy, dx = places.dy[:, None], places.dx[:, None]
    record = neighbours(state, places)                                          # [N, K, FIELDS, rows, cols]
    there = has_depth(record.movedim(2, 0), frame.num_bins)
    at = record[:, :, DEPTH] - record[:, :, SLOPE_COL] * dx - record[:, :, SLOPE_ROW] * dy
    tolerance = max_chi2 * record[:, :, STD]**2 + frame.resolution_bins**2
    count = there.sum(1)
    at, tolerance, free, record = (values.flatten(0, 1) for values in (at, tolerance, there, record))
    apart = wrap(at - at[:, None], frame.num_bins)                              # [V, V, rows, cols]
    close = agreement(apart, tolerance + tolerance[:, None])
    return SimpleNamespace(at=at, there=free.clone(), free=free, record=record, close=close, lean=close * apart,
                           count=count, used=neighbours(frame.exposure, places) > 0,
                           middle=slice(MIDDLE * surfaces, (MIDDLE + 1) * surfaces))


def _undecided(around):
    """Where a surface around is not the pixel's, or a pixel around has fewer; where there is one, if it has none."""
    known = (around.close[:, around.middle] * around.there[around.middle]).amax(1) > 0
    had = around.count[MIDDLE]
    differs = (around.there & ~known).any(0) | ((around.count > 0) & (around.count < had)).any(0)
    return torch.where(had > 0, differs, around.there.any(0))


def _best(k, around, before, rest, photons, light, frame) -> SimpleNamespace:
    """The candidate for the pixels' surface k with the highest log-likelihood ratio, and whether that is enough.

    Returns:
        found, point (the pixel's own, or the mean of what agrees), own (which of its own, or −1), agree (surfaces
        around, with the candidate), and depth and response of the pixel's photons.
    """
    free, close = around.free, around.close
    total = (close * free).sum(1).clamp(min=TINY)
    depth = around.at + (around.lean * free).sum(1) / total
    intensity = (close * (free * around.record[:, INTENSITY])).sum(1) / total
    number = torch.arange(1, len(before) + 1, device=free.device)[:, None, None]
    own = ((close[:, around.middle] > 0) * (free[around.middle] * number)).amax(1) - 1
    has_own, one = own >= 0, own.clamp(min=0)
    depth = torch.where(has_own, before[:, DEPTH].gather(0, one), depth)
    intensity = torch.where(has_own, before[:, INTENSITY].gather(0, one), intensity)
    response = (rest * waves(frame, depth).conj()).real.sum(2)

    score = _score(k, around, response, intensity * light, photons, frame)
    best = score.argmax(0, keepdim=True)
    score, response, depth, own = (values.gather(0, best)[0] for values in (score, response, depth, own))
    found = (score > 0) | ((around.count[MIDDLE] > 0) & (score > -torch.inf) & (k == 0))
    close = close.gather(0, best[:, None].expand(1, *close.shape[1:]))[0]
    weight = close * free
    point = (weight[:, None] * around.record).sum(0) / weight.sum(0).clamp(min=TINY)
    point[DEPTH], point[SCORE] = depth % frame.num_bins, 0
    kept = before.gather(0, own.clamp(min=0).expand(1, *before.shape[1:]))[0]
    return SimpleNamespace(found=found, point=torch.where(own >= 0, kept, point), own=own, agree=close > 0,
                           depth=depth, response=response)


def _score(k, around, response, expected, photons, frame):
    """Of each candidate as surface k: the pixels' log-likelihood ratio and votes; −∞ if it is taken."""
    speaks = around.used.clone()
    speaks[MIDDLE] = False
    surfaces = len(around.at) // len(around.count)
    votes = VOTE * (speaks & (around.count > k)).repeat_interleave(surfaces, 0) * around.free
    against = VOTE * torch.where(around.count > 0, 1, EMPTY_SHARE) * (speaks & (around.count <= k))
    likeness = constants.LIKENESS**2 if k > 0 else constants.LIKENESS
    ratio = llr(response, photons.expand_as(response), expected, likeness, frame)
    return (ratio + (around.close * votes).sum(1) - against.sum(0)).masked_fill(~around.free, -torch.inf)
