"""Removal of the points of rims that photons do not pay for: `trim` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, VALUE
from srt3d_ros.kernels.reference.arithmetic import has_depth, noise_ratio
from srt3d_ros.kernels.reference.likelihood import llr, surprise
from srt3d_ros.kernels.reference.search import blur


def trim(frame, state, terms, enough, scratch=None):
    view, terms = maps.crop(state, *frame.shape), maps.crop(terms, *frame.shape).astype(float)
    used = maps.crop(frame.exposure, *frame.shape) > 0
    for _ in range(SPREAD):
        rim = _rim(has_depth(view.swapaxes(2, 3), frame.num_bins).any(axis=1), used)
        counted = (view[:, :, INTENSITY] > 0) * rim[:, None]
        own = [terms[:, :, VALUE], terms[:, :, COUNTS], terms[:, :, EXPOSURE] * view[:, :, INTENSITY]]
        own = np.stack([(values * counted).sum(axis=1) for values in own], axis=1)
        pools = blur(own, np.ones(2 * VOTE_RADIUS + 1), 1)
        for i, j in np.argwhere(rim):
            response, photons, expected = pools[i, :, j]
            some = max(photons, 0.5)
            score = np.sqrt(some) * surprise(max(response, 0), some, frame)
            shown = score > enough * np.array([noise_ratio(frame, depth) for depth in view[i, :, DEPTH, j]])
            if llr(response, photons, expected, 1, frame) < 0:
                view[i, ~shown, INTENSITY, j] = 0


def _rim(there, used) -> np.ndarray:
    """Which pixels [rows, cols] with a surface have at least RIM used ones around without."""
    rows, cols = there.shape
    blank = np.pad(used & ~there, 1)
    around = sum(blank[y:y + rows, x:x + cols].astype(int) for y in range(3) for x in range(3))
    return there & (around >= RIM)
