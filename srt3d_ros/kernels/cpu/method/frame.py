"""A `MatchedFrame` as compiled code takes it: arrays, and numbers in single precision."""

from typing import NamedTuple

import numpy as np
from numba import float32

from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.maps import MAX_STD

EVEN = np.ones(1, np.float32)       # clutter of an even background


class Frame(NamedTuple):
    """The fields of `MatchedFrame` that kernels read, and two lengths. An even background has `clutter` of size 1."""

    matched: float32[:, :, ::1]
    counts: float32[:, ::1]
    exposure: float32[:, ::1]
    energy: float32[::1]
    bin_frequencies: float32[::1]
    moments: float32[::1]
    intensity_moments: float32[::1]
    background_table: float32[::1]
    clutter: float32[::1]
    max_response: float32
    total_energy: float32
    curvature: float32
    period: float32
    resolution: float32         # bins
    max_std: float32            # bins

    @classmethod
    def of(cls, frame) -> "Frame":
        """The fields of a MatchedFrame."""
        if isinstance(frame, cls):
            return frame
        clutter = EVEN if frame.clutter is None else frame.clutter
        arrays = (frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, frame.moments,
                  frame.intensity_moments, frame.background_table, clutter)
        return cls(*arrays, F32(frame.max_response), F32(frame.total_energy), F32(frame.curvature),
                   F32(frame.num_bins), F32(frame.resolution_bins), F32(MAX_STD * frame.num_bins))
