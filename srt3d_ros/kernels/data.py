"""What the kernels are given, and what keeps their memory; the notation is that of `kernels.api`."""

from collections.abc import Callable
from typing import Any, Protocol

Array = Any         # numpy.ndarray, or torch.Tensor on a GPU


class FrameData(Protocol):
    """What the kernels read of a frame; `core.matched_frame.MatchedFrame` has it. `pixelwise` takes it without padding.

    Args:
        matched: float32 [rows', 2m, cols'], z_l; 0 in masked pixels.
        counts: float32 [rows', cols'], n; 0 in masked pixels.
        exposure: float32 [rows', cols'], g; 0 in masked pixels.
        energy: float32 [m], |ĥ_l|².
        bin_frequencies: float32 [m], k_l / T.
        num_bins: T.
        moments: float32 [2], M₁ and M₀: variance of the score dR/dt that a signal, a background photon adds.
        intensity_moments: float32 [2], I₁ and I₀, the same for the score R.
        max_response: the largest R of one photon.
        background_table: float32 [n], ρ(u) for u = 0 … max_response, linear in between: a mean response u of
            background photons is worth ρ standard deviations per √photon (Chernoff's bound).
        total_energy, curvature: E and C.
        clutter: float32 [T], c(t): by how much scores at a depth exceed standard deviations; None for 1.
        origin: row and column of the first pixel in the whole array, if the frame is of a part of one.
        resolution_bins: δ.
        shape: rows, cols.
    """

    matched: Array
    counts: Array
    exposure: Array
    energy: Array
    bin_frequencies: Array
    num_bins: int
    moments: Array
    intensity_moments: Array
    max_response: float
    background_table: Array
    total_energy: float
    curvature: float
    clutter: Array | None
    origin: tuple[int, int]

    @property
    def resolution_bins(self) -> float: ...

    @property
    def shape(self) -> tuple[int, int]: ...


class PhotonData(Protocol):
    """What `poisson` reads of photons and sensor.

    Args:
        starts: int64 [rows · cols + 1]; toa: float32 [N], bins: pixel p saw toa[starts[p]:starts[p + 1]].
        irf, slope: float32 [1 or rows · cols, L], h and h′; `ref`: index into them that marks the depth.
        information: of a signal photon on the depth, bins⁻².
        num_bins: T.
        exposure: float32 [rows, cols], g; 0 in masked pixels.
    """

    starts: Array
    toa: Array
    irf: Array
    slope: Array
    ref: int
    information: float
    num_bins: int
    exposure: Array


class Scratch(Protocol):
    """Memory that a reconstruction keeps from frame to frame."""

    def array(self, name: str, shape: tuple, zero: bool = False) -> Array:
        """The float32 array of this name and shape: as it was left, or 0 if `zero` is set or it is new."""


class FrameStream(Protocol):
    """Frames through a sequence of kernels; a device may upload, compute and download different frames at once.

    Args:
        function: of a frame's arrays; returns a tuple of arrays that ends with the points of `collect`.
    """

    def __init__(self, function: Callable[..., tuple]): ...

    def submit(self, *frame: Array) -> Callable[[], tuple]:
        """Begin a frame, of arrays of any device; they may change once this returns.

        Returns:
            A function that waits for the results: NumPy arrays, the points as `unpack` gives them.
        """
