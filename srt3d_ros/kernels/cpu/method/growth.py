"""Refuse growth: remove the new points that neither their own photons nor those of the new pixels around them show.

A pixel is new if birth/death has given it its first surface. Its v, n and g r are summed over the new pixels within
NEW_RADIUS (a square). Its points go if the log-likelihood ratios of its own v, n, g r and of these sums are both below
0: photons that no earlier surface has used say "empty", rather than "the surface goes on". A pixel with points that
stay within HOLE pixels on three of its four sides keeps its own: it is a hole, and beyond no outline.
"""

import numpy as np
from numba import boolean, float32, get_thread_id, prange

from srt3d_ros.kernels.constants import HOLE, NEW_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TWO, ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import LIKENESS, llr
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import COUNTS, INTENSITY, LANES, MARGIN, TERMS, VALUE

RESPONSE, PHOTONS, EXPECTED = range(3)                          # rows of `fresh`: v, n, g r
EMPTY, SHOWN, REFUSED = ZERO, ONE, TWO      # values of `mark`
HOLE_SIDES = F32(3)


@line
def _has_points(i, j, state):
    there = full(False)
    for k in range(state.shape[1]):
        there |= load(state, i, k, INTENSITY, j) > ZERO
    return there


@parallel
def _note(state: float32[:, :, :, ::1], had: float32[:, ::1]):
    for i in prange(len(state)):
        for j in range(0, state.shape[3], LANES):
            store(had, i, j, where(_has_points(i, j, state), ONE, ZERO))


@line
def _find_new(i, frame, state, terms, had, fresh, mark):
    """Write v, n and g r of the new pixels of a row, 0 elsewhere, and its marks; whether there are new ones."""
    found = False
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        exposure, there = load(frame.exposure, i, j), _has_points(i, j, state)
        is_new = there & (load(had, i, j) == ZERO)
        response, photons, expected = full(ZERO), full(ZERO), full(ZERO)
        for k in range(state.shape[1]):
            intensity = load(state, i, k, INTENSITY, j)
            new = is_new & (intensity > ZERO)
            response += where(new, load(terms, i, k, VALUE, j), ZERO)
            photons += where(new, load(terms, i, k, COUNTS, j), ZERO)
            expected += where(new, exposure * intensity, ZERO)
        store(fresh, i, RESPONSE, j, response)
        store(fresh, i, PHOTONS, j, photons)
        store(fresh, i, EXPECTED, j, expected)
        store(mark, i, j, where(there, SHOWN, EMPTY))
        found |= lanes_of(is_new) > 0
    return found


@line
def _judge_row(i, frame, fresh, sums, mark):
    """Mark the new pixels of a row that nothing shows as REFUSED; whether there are any."""
    refused = False
    for j in range(0, fresh.shape[2], LANES):
        for c in range(EXPECTED + 1):
            total = full(ZERO)
            for a in range(i - NEW_RADIUS, i + NEW_RADIUS + 1):
                total += load(fresh, a, c, j)
            store(sums, c, j, total)
    for j in range(MARGIN, fresh.shape[2] - MARGIN, LANES):
        response, photons, expected = load(fresh, i, RESPONSE, j), load(fresh, i, PHOTONS, j), load(
            fresh, i, EXPECTED, j)
        unlikely = (expected > ZERO) & (llr(response, photons, expected, LIKENESS, frame) < ZERO)
        if lanes_of(unlikely):
            response, photons, expected = full(ZERO), full(ZERO), full(ZERO)
            for b in range(j - NEW_RADIUS, j + NEW_RADIUS + 1):
                response += load(sums, RESPONSE, b)
                photons += load(sums, PHOTONS, b)
                expected += load(sums, EXPECTED, b)
            unlikely &= llr(response, photons, expected, LIKENESS, frame) < ZERO
            store(mark, i, j, where(unlikely, REFUSED, load(mark, i, j)))
            refused |= lanes_of(unlikely) > 0
    return refused


@line
def _remove_row(i, mark, state, terms):
    """Remove the points of refused pixels that are no holes."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        goes = load(mark, i, j) == REFUSED
        if lanes_of(goes):
            sides = full(ZERO)
            for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                shown = full(False)
                for distance in range(1, HOLE + 1):
                    shown |= load(mark, i + distance * down, j + distance * right) == SHOWN
                sides += where(shown, ONE, ZERO)
            goes &= sides < HOLE_SIDES
            for k in range(state.shape[1]):
                store(state, i, k, INTENSITY, j, where(goes, ZERO, load(state, i, k, INTENSITY, j)))
                for f in range(TERMS):
                    store(terms, i, k, f, j, where(goes, ZERO, load(terms, i, k, f, j)))


@parallel
def _refuse(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], had: float32[:, ::1],
            fresh: float32[:, :, ::1], mark: float32[:, ::1], sums: float32[:, :, ::1], found: boolean[::1]):
    for turn in prange(len(found)):
        found[turn] = _find_new(turn + MARGIN, frame, state, terms, had, fresh, mark)
    if found.any():
        for turn in prange(len(found)):
            found[turn] = found[turn] and _judge_row(turn + MARGIN, frame, fresh, sums[get_thread_id()], mark)
        for turn in prange(len(found)):
            if found[turn]:
                _remove_row(turn + MARGIN, mark, state, terms)


def note_surfaces(work, state):
    """Remember which pixels have points, for `refuse_growth`."""
    _note(state, work.had)


def refuse_growth(work, frame, state, terms):
    """Remove the points that the change since `note_surfaces` should not have made, and their terms, in place."""
    found = np.zeros(len(state) - 2 * MARGIN, np.bool_)
    _refuse(frame, state, terms, work.had, work.rim, work.blank, work.means, found)
