"""What must go: growth that no photons show, ghosts, dim outlines, and blobs of chance."""

import math

import torch

from srt3d_ros.kernels.constants import (
    EPSILON,
    HOLE,
    HOLE_SIDES,
    LIKENESS,
    NEW_RADIUS,
    REACH,
    RIM,
    TRIMMED,
    VOTE_RADIUS,
    WINDOWS,
    WRONG_SHAPE,
)
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, SCORE, VALUE
from srt3d_ros.kernels.torch.arithmetic import by_bin, has_depth, noise_ratio
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.likelihood import evidence, llr
from srt3d_ros.kernels.torch.method.windows import box, images, inner


@fused
def refuse_growth(frame, before, state, terms) -> None:
    """Remove new points that neither their own photons nor those of the new pixels around them show, in place: r = 0.

    A pixel is new if it had no surface `before`. Its v, n and g r are summed over the new pixels within NEW_RADIUS (a
    square). Its points go if the ratios of `log_likelihood_ratio` for its own v, n, g r and for these sums are both
    below 0: photons that no earlier surface has used say "empty", rather than "the surface goes on". Beyond an outline,
    votes alone would let a dim surface grow in every iteration. A pixel with points that stay within HOLE pixels on
    HOLE_SIDES of its sides keeps its own: it is a hole, and beyond no outline.
    """
    had = (images(frame, before)[:, INTENSITY] > 0).any(0)
    point, terms = images(frame, state), images(frame, terms)
    intensity = point[:, INTENSITY]
    there = intensity > 0
    new = there & ~had
    own = [(values * new).sum(0) for values in (
        terms[:, VALUE], terms[:, COUNTS], terms[:, EXPOSURE] * intensity)]
    refused = new.any(0)
    for sums in (own, [box(values, NEW_RADIUS) for values in own]):
        refused = refused & (llr(*sums, LIKENESS, frame) < 0)
    shown, (rows, cols) = there.any(0) & ~refused, frame.shape
    wide = torch.nn.functional.pad(shown.to(state.dtype), (HOLE,) * 4)
    down, across = wide[:, HOLE:HOLE + cols], wide[HOLE:HOLE + rows]
    sides = sum(part.unfold(axis, HOLE, 1).amax(-1).narrow(axis, first, size) for part, axis, size in (
        (down, 0, rows), (across, 1, cols)) for first in (0, HOLE + 1))
    refused = refused & (sides < HOLE_SIDES)
    intensity.masked_fill_(refused, 0)
    terms.masked_fill_(refused, 0)


def drop_ghosts(frame, state) -> None:
    """Remove ghosts, in place: r = 0. The surfaces of a pixel still come first, without a gap.

    If the IRF is ĥ (1 + d) instead of ĥ, a surface of intensity r₁ leaves r₁ ĥ d, and a further one is fitted to it. d
    is the same for all photons: the more are pooled, the surer the ghost, and no score tells it from a surface. Its
    size does. Of a surface at distance Δ, let u(Δ) be the part that no correction of the first one's intensity, depth,
    width and skew explains (‖u‖ / ‖ĥ‖ is `frame.unlike`). What d leaves beyond these shows a second
    surface with r₂ ‖u(Δ)‖ ≤ ‖d‖ r₁ (Cauchy-Schwarz). So a surface goes if

        r_k Π_j ‖u(t_k − t_j)‖ < WRONG_SHAPE · min(Σ_j r_j, n / g),    j: the pixel's stronger surfaces.

    n / g, because the pool makes the halo of a retro-reflector brighter than all of a pixel's photons.
    """
    if state.shape[1] > 1:          # with one surface a pixel, nothing is to be launched
        _drop_ghosts(frame, state)


@fused
def _drop_ghosts(frame, state) -> None:
    point = images(frame, state)
    depth, intensity = point[:, DEPTH], point[:, INTENSITY].clone()
    light = inner(frame, frame.counts) / inner(frame, frame.exposure).clamp(min=EPSILON)
    for k in range(len(point)):
        stronger, shown = torch.zeros_like(light), intensity[k]
        for o in (*range(k), *range(k + 1, len(point))):
            is_stronger = (intensity[o] > intensity[k]) | ((intensity[o] == intensity[k]) & (o < k))
            is_stronger = is_stronger & (intensity[o] > 0)
            stronger = stronger + intensity[o] * is_stronger
            shown = torch.where(is_stronger, shown * by_bin(frame.unlike, depth[k] - depth[o]), shown)
        point[k, INTENSITY].masked_fill_(shown < WRONG_SHAPE * torch.minimum(stronger, light), 0)
    for last in range(len(point) - 1, 0, -1):
        for k in range(last):
            low, high = point[k].clone(), point[k + 1].clone()
            gap = (low[INTENSITY] <= 0) & (high[INTENSITY] > 0)
            point[k].copy_(torch.where(gap, high, low))
            point[k + 1].copy_(torch.where(gap, low, high))


def trim(frame, state, terms, enough):
    """Remove edge points not supported by the photons near the edge: r = 0, in place.

    A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. What the pixels of
    the rim within VOTE_RADIUS (a square) show is pooled: V = Σ v, p = Σ n, μ = Σ g r, over their points. A point of
    the pixel goes if these photons do not show a surface of any intensity, √p ρ(V₊ / p) / c(t) ≤ `enough`, and are
    less likely with a surface as bright as the pools of `pooled_step` make it than with none: for this V, p and μ the
    ratio of `log_likelihood_ratio` is below 0. The pixels behind are the next rim, TRIMMED times. `terms` are `expand`
    of the state.
    """
    for _ in range(TRIMMED):
        _trim_once(frame, state, terms, enough)


@fused
def _trim_once(frame, state, terms, enough) -> None:
    point, terms, used = images(frame, state), images(frame, terms), inner(frame, frame.exposure) > 0
    intensity = point[:, INTENSITY]
    there = has_depth(point.movedim(1, 0), frame.num_bins).any(0)
    rim = there & (box((used & ~there).to(state.dtype), 1) > RIM - 0.5)
    counted = rim & (intensity > 0)
    response, photons, expected = (box((values * counted).sum(0), VOTE_RADIUS) for values in (
        terms[:, VALUE], terms[:, COUNTS], terms[:, EXPOSURE] * intensity))
    some = photons.clamp(min=0.5)
    score = evidence(response, some, some, frame)
    unpaid = rim & (llr(response, photons, expected, 1, frame) < 0)
    weak = score <= enough * noise_ratio(frame, point[:, DEPTH])
    intensity.masked_fill_(unpaid & weak, 0)


@fused
def drop_blobs(frame, state, enough) -> None:
    """Remove points without a score / c(t) of `enough` within the reach of the last window (a square), in place: r = 0.

    A chance maximum of the wide window grows by pixels that do not support it: its score stays about what it started
    with. That of a surface grows with its pixels.
    """
    point, radius = images(frame, state), math.ceil(REACH * WINDOWS[-1].sigma)
    intensity = point[:, INTENSITY]
    sure = ((point[:, SCORE] / noise_ratio(frame, point[:, DEPTH]) >= enough) & (intensity > 0)).any(0)
    near = torch.nn.functional.max_pool2d(sure.to(state.dtype)[None], 2 * radius + 1, stride=1, padding=radius)[0]
    intensity.masked_fill_(near < 0.5, 0)
