"""A `MatchedFrame` as compiled code takes it: arrays, and numbers in single precision."""

from typing import NamedTuple
from weakref import WeakKeyDictionary

from numba import float32

from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.maps import MAX_STD


class Frame(NamedTuple):
    """The fields of `MatchedFrame` that kernels read, and two lengths."""

    matched: float32[:, :, ::1]
    counts: float32[:, ::1]
    exposure: float32[:, ::1]
    energy: float32[::1]
    bin_frequencies: float32[::1]
    moments: float32[::1]
    intensity_moments: float32[::1]
    background_table: float32[::1]
    clutter: float32[::1]
    unlike: float32[::1]
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
            arrays = (frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, frame.moments,
                      frame.intensity_moments, frame.background_table, frame.clutter,
                      frame.unlike)
            numbers = (frame.max_response, frame.total_energy, frame.curvature, frame.num_bins, frame.resolution_bins,
                       MAX_STD * frame.num_bins)
            FRAMES[frame] = cls(*arrays, *map(F32, numbers))
        return FRAMES[frame]


FRAMES: WeakKeyDictionary[object, Frame] = WeakKeyDictionary()
