"""A MatchedFrame as compiled code takes it: arrays, and numbers in single precision."""

from typing import NamedTuple

import numpy as np

from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.maps import MAX_STD


class Frame(NamedTuple):
    """The fields of `MatchedFrame` that kernels read, and two lengths; `clutter` is [1] if the background is even."""

    matched: np.ndarray
    counts: np.ndarray
    exposure: np.ndarray
    energy: np.ndarray
    bin_frequencies: np.ndarray
    moments: np.ndarray
    intensity_moments: np.ndarray
    background_table: np.ndarray
    clutter: np.ndarray
    max_response: np.float32
    total_energy: np.float32
    curvature: np.float32
    period: np.float32
    resolution: np.float32          # bins
    max_std: np.float32             # bins


def as_compiled(frame) -> Frame:
    """The same frame for compiled code."""
    clutter = np.ones(1, np.float32) if frame.clutter is None else frame.clutter
    return Frame(frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, frame.moments,
                 frame.intensity_moments, frame.background_table, clutter, F32(frame.max_response),
                 F32(frame.total_energy), F32(frame.curvature), F32(frame.num_bins), F32(frame.resolution_bins),
                 F32(MAX_STD * frame.num_bins))
