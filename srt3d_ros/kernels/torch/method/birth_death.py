"""Birth/death update: creates and removes points (`birth_death`).

Images are the last axes. Before them: V, the surfaces around a pixel, which vote, place by place; C, those of its
3 × 3 neighbourhood, the candidates. What depends on both is computed anew in each sum over V: it is not worth storing.
"""

from typing import NamedTuple

import torch

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import BIRTH_COST, FEWER_COST, SPREAD, TINY, VOTE, VOTE_RADIUS
from srt3d_ros.kernels.maps import DEPTH, FIELDS, INTENSITY, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.torch.arithmetic import agreement, explained, has_depth, waves, wrap
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.drops import drop_ghosts, refuse_growth
from srt3d_ros.kernels.torch.method.likelihood import llr, log_likelihood_ratio
from srt3d_ros.kernels.torch.method.sketches import expand
from srt3d_ros.kernels.torch.method.windows import box, images, inner, neighbours, offsets, pad_images

SIDE = 2 * VOTE_RADIUS + 1


def birth_death(frame, state, terms, max_chi2):
    """Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood, or none.

    Candidates are the surfaces q of the neighbourhood (VOTE_RADIUS), carried along their planes: t_q − slopes ·
    offset. Two agree by a = (1 − e² / (v_q + v_c))₊, e = wrap(t_q − t_c), v = max_chi2 · std² + min(δ, Δ / 2)²
    with Δ the distance to the nearest other surface of the same pixel: the two shall not count as one.
    The pixel's surface k is the candidate c of its 3 × 3 neighbourhood with the highest

        ratio of the pixel's photons + Σ_q w_q a_qc clip(VOTE + ratio_q, 0, MAX_VOTES · VOTE)
            − Σ_q w_q FEWER_COST / count_q

    (see `log_likelihood_ratio`), w = exp(−distance² / 2 NEAR_SIGMA²). The last sum, for k > 0, is over the surfaces
    of neighbours that have no more than k. For these, the vote of what they show is w FEWER_COST, so that they speak
    neither for nor against it: a pixel that truly sees two surfaces keeps both, and edges show few double points. A
    candidate needs BIRTH_COST, unless it is for the first surface of a pixel that has one; in a pixel without surfaces,
    EMPTY_VOTES · VOTE · w more for each used neighbour without a surface, of those without photons times
    1 − exp(−g r), the probability that it would show there. The pixel keeps its own point if that agrees with the best,
    else it takes the mean of what agrees, weighted by w a, with score and residual 0. What agrees and the photons it
    explains are left out for the next k. Points with a standard deviation above MAX_STD · T count as none. Pixels stay
    as they are where their 3 × 3 neighbourhood agrees with them already.

    Then SPREAD more times, for pixels with fewer than K surfaces of whose neighbourhood the time before has
    changed: surfaces so grow by as many pixels. What no photons show of this growth goes (`refuse_growth`), and what a
    wrong IRF may have left (`drop_ghosts`).
    """
    before, own = state, log_likelihood_ratio(frame, state, terms)
    may_choose = frame.exposure > 0
    for _ in range(1 + SPREAD):
        state, own, may_choose = _round(frame, state, own, may_choose, max_chi2)
    terms = expand(frame, state)
    refuse_growth(frame, before, state, terms)
    if state.shape[1] > 1:
        drop_ghosts(frame, state)
        terms = expand(frame, state)
    return state, terms


@fused
def _round(frame, state, own, may_choose, max_chi2) -> tuple:
    """Let all pixels choose from one state: the next state, the ratios of its points, and which pixels choose next."""
    before, ratios = images(frame, state), images(frame, own)
    around = _around(frame, state, own, max_chi2)
    chooses = inner(frame, may_choose) & around.undecided
    rest, photons, light = (inner(frame, values) for values in (frame.matched, frame.counts, frame.exposure))
    rest = rest.chunk(2, dim=1)
    field = torch.arange(FIELDS, device=state.device)[:, None, None]
    free, points, after, changed = around.there, [], [], torch.zeros_like(chooses)
    for k in range(len(before)):
        best = _best(k, around, free, before, rest, photons, light, frame)
        found = chooses & best.found
        gone = (field == INTENSITY) & chooses & ~found
        points.append(torch.where(found, best.point, before[k]).masked_fill(gone, 0))
        after.append(torch.where(found, best.ratio, ratios[k]))
        changed = changed | chooses & torch.where(found, best.own != k, before[k, INTENSITY] > 0)
        free = free & ~(best.agree & found)
        gives = torch.where(found, best.response.clamp(min=0) / frame.total_energy, 0)
        rest = [part - given for part, given in zip(rest, explained(frame, waves(frame, best.depth), gives))]
        photons = torch.where(photons > 0, (photons - gives).clamp(min=0.5), 0)
    points = torch.stack(points)
    has_room = has_depth(points.movedim(1, 0), frame.num_bins).sum(0) < len(before)
    near_change = box(changed.to(state.dtype), VOTE_RADIUS) > 0.5
    may_choose = near_change & has_room & (light > 0)
    return tuple(map(pad_images, (points, torch.stack(after), may_choose)))


def _close_by(voters):
    """The voters in the 3 × 3 neighbourhood, which are the candidates."""
    places = voters.unflatten(0, (SIDE, SIDE, -1))[VOTE_RADIUS - 1:VOTE_RADIUS + 2, VOTE_RADIUS - 1:VOTE_RADIUS + 2]
    return places.flatten(0, 2)


class Around(NamedTuple):
    """The voters of each pixel, carried there along their planes: images [V, rows, cols], or as each says."""

    record: torch.Tensor        # their fields, [V, FIELDS, rows, cols]
    at: torch.Tensor            # depths,
    tolerance: torch.Tensor     # squares of how far these may be off,
    vote: torch.Tensor          # and nats
    there: torch.Tensor         # whether there is a surface
    count: torch.Tensor         # how many surfaces its pixel has
    weight: torch.Tensor        # by their distance, [V, 1, 1]
    other: torch.Tensor         # whether it is another pixel's, [V, 1, 1]
    had: torch.Tensor           # how many surfaces the pixel has, [rows, cols]
    blank: torch.Tensor         # nats that a first surface needs for neighbours with photons but no surface
    dark: torch.Tensor          # and loses, if bright, for neighbours without photons, [rows, cols]
    undecided: torch.Tensor     # pixels whose 3 × 3 neighbourhood does not agree with them, [rows, cols]
    period: int

    def apart(self, at, tolerance):
        """How voters agree with candidates at depths [C, rows, cols], and how far they are: [C, V, rows, cols] each."""
        apart = wrap(self.at - at[:, None], self.period)
        return agreement(apart, self.tolerance + tolerance[:, None]), apart

    def of_pixel(self, voters):
        """The pixel's own surfaces among the voters, [K, …]."""
        return voters.unflatten(0, (SIDE**2, -1))[SIDE**2 // 2]

    def like_own(self):
        """How candidates agree with the pixel's own surfaces, [C, K, rows, cols]."""
        close, _ = self.apart(self.of_pixel(self.at), self.of_pixel(self.tolerance))            # [K, V, rows, cols]
        return _close_by(close.movedim(1, 0))


def _around(frame, state, own, max_chi2) -> Around:
    """The voters of each pixel."""
    period, surfaces = frame.num_bins, state.shape[1]
    dy, dx = offsets(VOTE_RADIUS, state)
    record = neighbours(frame, state, VOTE_RADIUS)                              # [N, K, FIELDS, rows, cols]
    weight = torch.exp(-(dy**2 + dx**2) / (2 * constants.NEAR_SIGMA**2))
    there, is_other = has_depth(record.movedim(2, 0), period), (dy != 0) | (dx != 0)
    count = there.sum(1)
    had = count[SIDE**2 // 2]
    ratio = neighbours(frame, own, VOTE_RADIUS)
    vote = (VOTE + ratio).clamp(0, constants.MAX_VOTES * VOTE) * weight[:, None]
    at = record[:, :, DEPTH] - record[:, :, SLOPE_COL] * dx[:, None] - record[:, :, SLOPE_ROW] * dy[:, None]
    tolerance = neighbours(frame, _tolerance(frame, state, max_chi2), VOTE_RADIUS)
    counts, exposure = (neighbours(frame, values, VOTE_RADIUS) for values in (frame.counts, frame.exposure))
    gap = weight * ((count == 0) & (had == 0) & is_other) * constants.EMPTY_VOTES * VOTE
    blank, dark = ((gap * where).sum(0) for where in (counts > 0, (counts <= 0) & (exposure > 0)))
    each = (values.flatten(0, 1) for values in (record, at, tolerance, vote, there))
    around = Around(*each, *(values.repeat_interleave(surfaces, 0) for values in (count, weight, is_other)), had, blank,
                    dark, had > 0, period)
    return around._replace(undecided=_undecided(around))


def _tolerance(frame, state, max_chi2):
    """v of points."""
    room = torch.full_like(state[:, :, DEPTH], frame.resolution_bins**2)
    for turn in range(1, state.shape[1]):
        other = state.roll(turn, 1)
        apart = wrap(other[:, :, DEPTH] - state[:, :, DEPTH], frame.num_bins) / 2
        room = torch.where(has_depth(other.movedim(2, 0), frame.num_bins), torch.minimum(room, apart**2), room)
    return max_chi2 * state[:, :, STD]**2 + room


def _undecided(around):
    """Pixels that lack a candidate, or have more surfaces than a neighbour; of empty ones, those with a candidate."""
    known = (around.like_own() * around.of_pixel(around.there)).amax(1) > 0
    there, fewer = _close_by(around.there), _close_by(around.count) < around.had
    return torch.where(around.had > 0, (there & (~known | fewer)).any(0), there.any(0))


class Best(NamedTuple):
    """The candidate for the pixels' surface k with the highest log-likelihood ratio; images [rows, cols]."""

    found: torch.Tensor         # whether the ratio is high enough
    point: torch.Tensor         # the pixel's own, or the mean of what agrees, [FIELDS, rows, cols]
    own: torch.Tensor           # which of its own, or −1
    agree: torch.Tensor         # voters, with the candidate, [V, rows, cols]
    depth: torch.Tensor
    ratio: torch.Tensor         # of the pixel's own photons, nats
    response: torch.Tensor      # of these photons at the depth


def _best(k, around, free, before, rest, photons, light, frame) -> Best:
    """The best of the candidates that no earlier surface has taken."""
    at, tolerance, candidates = _close_by(around.at), _close_by(around.tolerance), _close_by(free)
    weight = around.weight * free
    close, apart = around.apart(at, tolerance)
    total = (close * weight).sum(1).clamp(min=TINY)
    depth = at + (close * apart * weight).sum(1) / total
    intensity = (close * (weight * around.record[:, INTENSITY])).sum(1) / total
    votes, against = around.vote * (free & around.other), 0
    if k > 0:
        fewer = around.there & around.other & (around.count <= k)
        votes = torch.where(fewer, around.weight * (FEWER_COST * free), votes)        # no vote against what they show
        against = (around.weight * FEWER_COST / around.count.clamp(min=1) * fewer).sum(0)
    votes = (close * votes).sum(1)

    number = torch.arange(1, len(before) + 1, device=free.device, dtype=torch.int8)[:, None, None]
    own = ((around.like_own() > 0) * (around.of_pixel(free) * number)).amax(1) - 1
    has_own, one = own >= 0, own.clamp(min=0).long()
    depth = torch.where(has_own, before[:, DEPTH].gather(0, one), depth)
    intensity = torch.where(has_own, before[:, INTENSITY].gather(0, one), intensity)

    response = sum(part * wave for part, wave in zip(rest, waves(frame, depth))).sum(2)
    likeness = constants.LIKENESS**2 if k > 0 else constants.LIKENESS
    ratio = llr(response, photons.expand_as(response), intensity * light, likeness, frame)
    against = against + around.dark * (1 - torch.exp(-intensity * light))
    score = (ratio + votes - against).masked_fill(~candidates, -torch.inf)
    best = score.argmax(0, keepdim=True)
    score, ratio, response, depth, own, at, tolerance = (values.gather(0, best)[0] for values in (
        score, ratio, response, depth, own, at, tolerance))
    least = BIRTH_COST + around.blank
    least = least.masked_fill(around.had > 0, -torch.inf) if k == 0 else least
    close, = around.apart(at[None], tolerance[None])[0]
    weight = weight * close
    total = weight.sum(0).clamp(min=TINY)
    mean = [(weight * around.record[:, field]).sum(0) / total for field in range(FIELDS)]      # a sum each: one launch
    mean[DEPTH], mean[SCORE], mean[RESIDUAL] = depth % frame.num_bins, torch.zeros_like(total), torch.zeros_like(total)
    point = torch.stack(mean)
    kept = before.gather(0, own.clamp(min=0).long().expand(1, *before.shape[1:]))[0]
    return Best(score > least, torch.where(own >= 0, kept, point), own, close > 0, depth, ratio, response)
