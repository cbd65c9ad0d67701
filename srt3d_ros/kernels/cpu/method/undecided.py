"""Find the pixels in which the birth/death update has something to decide.

A pixel is decided if each surface of its 3 × 3 neighbourhood agrees with one of its own, e² < max_chi2 (std² + std_q²)
+ 2 δ² with e their distance at the pixel, and no neighbour that has surfaces has fewer than it.
"""

from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO, is_surface, wrap
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, LANES, MARGIN, SLOPE_COL, SLOPE_ROW, STD

AROUND = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy)


@inline
def _surface(state, row, k, col, frame):
    """Whether there is a surface whose depth is known, and its standard deviation."""
    std = load(state, row, k, STD, col)
    return is_surface(load(state, row, k, INTENSITY, col), std, frame.max_std), std


@inline
def _is_unknown(state, row, q, col, offset, max_chi2, frame):
    """Whether the neighbours' surfaces q agree with none of the pixels' own; and whether there are any."""
    dy, dx = offset
    there, std = _surface(state, row + dy, q, col + dx, frame)
    unknown, depth = there, load(state, row + dy, q, DEPTH, col + dx) - (
        load(state, row + dy, q, SLOPE_COL, col + dx) * F32(dx)
        + load(state, row + dy, q, SLOPE_ROW, col + dx) * F32(dy))
    tolerance = max_chi2 * std * std + F32(2) * frame.resolution * frame.resolution
    for k in range(state.shape[1]):
        own, own_std = _surface(state, row, k, col, frame)
        e = wrap(depth - load(state, row, k, DEPTH, col), frame.period)
        unknown &= ~(own & (e * e < tolerance + max_chi2 * own_std * own_std))
    return unknown, there


@line
def _undecided(state, row, col, max_chi2, frame, grows):
    """In which of the pixels from (row, col) on there is something to decide, as bits."""
    surfaces, had = state.shape[1], full(ZERO)
    for k in range(surfaces):
        had += where(_surface(state, row, k, col, frame)[0], 1, 0)
    undecided, may_grow = full(False), had < F32(surfaces)
    if grows and lanes_of(may_grow) == 0:
        return 0
    for offset in AROUND:
        around = full(ZERO)
        for q in range(surfaces):
            unknown, there = _is_unknown(state, row, q, col, offset, max_chi2, frame)
            around += where(there, 1, 0)
            undecided |= unknown
        undecided |= (around > 0) & (around < had)
    undecided &= load(frame.exposure, row, col) > 0
    return lanes_of(undecided & may_grow if grows else undecided)


@line
def list_row(row, frame, state, max_chi2, near, grows, cols):
    """Write the columns of a row's used pixels that have something to decide; returns how many they are.

    Only pixels near a change, where `near` is 1; if surfaces grow (`grows`), with fewer than K surfaces.
    """
    found = 0
    for first in range(MARGIN, state.shape[3] - MARGIN, LANES):
        close = lanes_of(load(near, row, first) > 0)
        if close != 0:
            close &= _undecided(state, row, first, max_chi2, frame, grows)
            for x in range(LANES):
                if close >> x & 1:
                    cols[found] = first + x
                    found += 1
    return found


@line
def join_rows(cols, number, pixels):
    """Join the lists of the rows; repeat the last pixel up to whole vectors. Returns how many there are."""
    found = 0
    for i in range(MARGIN, len(cols) - MARGIN):
        for n in range(number[i]):
            pixels[0, found], pixels[1, found] = i, cols[i, n]
            found += 1
    for n in range(found, found + -found % LANES):
        pixels[0, n], pixels[1, n] = pixels[0, found - 1], pixels[1, found - 1]
    return found
