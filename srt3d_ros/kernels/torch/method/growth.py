"""What keeps chance from growing: `refuse_growth` in each birth/death update, `drop_blobs` at the end."""

import math

import torch

from srt3d_ros.kernels.constants import HOLE, HOLE_SIDES, LIKENESS, NEW_RADIUS, REACH, WINDOWS
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, SCORE, VALUE
from srt3d_ros.kernels.torch.arithmetic import noise_ratio
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.likelihood import llr
from srt3d_ros.kernels.torch.method.windows import box, images


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
