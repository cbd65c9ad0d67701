"""What the tests of the CUDA kernels share."""

from srt3d_ros.core.matched_frame import MatchedFrame
from srt3d_ros.kernels import reference


def frame_on(cuda, frame: MatchedFrame) -> MatchedFrame:
    """The frame with its arrays on the device."""
    return frame.on(cuda)


def others() -> list:
    """What the CUDA kernels are held against: the float64 reference, and the CPU kernels where numba is installed."""
    try:
        import numba  # noqa: F401
    except ImportError:
        return [reference]
    from srt3d_ros.kernels import cpu
    return [reference, cpu]


