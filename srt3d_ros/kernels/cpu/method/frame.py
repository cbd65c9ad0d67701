"""What the kernels of a frame read and write: a `MatchedFrame` as compiled code takes it, and points."""

from typing import NamedTuple
from weakref import WeakKeyDictionary

from numba import float32

from srt3d_ros.kernels.cpu.arithmetic import F32, sincos
from srt3d_ros.kernels.cpu.compiling import floats1d, floats2d, floats3d, inline
from srt3d_ros.kernels.cpu.vectors import floats, full
from srt3d_ros.kernels.maps import MAX_STD

AROUND = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy)      # a pixel's eight neighbours


class Frame(NamedTuple):
    """The fields of `MatchedFrame` that kernels read, and two lengths."""

    matched: floats3d
    counts: floats2d
    exposure: floats2d
    energy: floats1d
    bin_frequencies: floats1d
    moments: floats1d
    intensity_moments: floats1d
    background_table: floats1d
    clutter: floats1d
    unlike: floats1d
    overlap: floats2d
    max_response: float32
    total_energy: float32
    curvature: float32
    period: float32
    resolution: float32         # bins
    max_std: float32            # bins

    @classmethod
    def of(cls, frame) -> "Frame":
        """The fields of a MatchedFrame, gathered once for all of its kernels."""
        if isinstance(frame, cls):
            return frame
        if frame not in FRAMES:
            arrays = (getattr(frame, name) for name in cls._fields[:11])
            numbers = (frame.max_response, frame.total_energy, frame.curvature, frame.num_bins, frame.resolution_bins,
                       MAX_STD * frame.num_bins)
            FRAMES[frame] = cls(*arrays, *map(F32, numbers))
        return FRAMES[frame]


FRAMES: WeakKeyDictionary[object, Frame] = WeakKeyDictionary()


class Point(NamedTuple):
    """LANES points, by the fields of `maps`."""

    depth: floats
    slope_col: floats
    slope_row: floats
    intensity: floats
    std: floats
    score: floats
    residual: floats


@inline
def point_at(state, i, k, j):
    """The points k of the pixels (i, j); fields that the caller does not use are not read."""
    return Point(state[i, k, 0, j], state[i, k, 1, j], state[i, k, 2, j], state[i, k, 3, j],
                 state[i, k, 4, j], state[i, k, 5, j], state[i, k, 6, j])


@inline
def is_surface(point, frame):
    """Whether there is a surface whose depth is known."""
    return (point.intensity > 0) & (point.std < frame.max_std)


@inline
def without(re, im, l, signal, depth, frame):
    """z_l − signal |ĥ_l|² exp(i ω_l depth): real and imaginary part."""
    sine, cosine = sincos(frame.bin_frequencies[l] * depth)
    given = signal * frame.energy[l]
    return re - given * cosine, im - given * sine


@inline
def response_at(z, at, depth, frame):
    """R(z, depth) of sketches [2m, …] in the columns `at`."""
    response, m = full(0.0), len(frame.bin_frequencies)
    for l in range(m):
        sine, cosine = sincos(frame.bin_frequencies[l] * depth)
        response += z[l, at] * cosine + z[m + l, at] * sine
    return response
