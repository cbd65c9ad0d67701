"""Kernels: what a device runs. `kernels.torch` has the equations and the notation; `kernels.cpu` computes the same.

A frame is a `MatchedFrame` of `core.method.matched_frame`. Complex maps are float32 [rows, 2m, cols], real parts before
imaginary ones. Maps with rows', cols' are padded. Points are states, float32 [rows', K, FIELDS, cols'], terms float32
[rows', K, TERMS, cols'] (`kernels.maps`). Arrays are on the device unless said to be NumPy's; complex ones there may
be pairs of reals, [..., 2]. What a kernel returns is valid until the next frame.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

Array = Any         # NumPy's or torch's


class Device(Protocol):
    """A device that has kernels."""

    def for_shape(self, rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]) -> "Kernels":
        """Kernels with the memory of frames of rows × cols pixels, K surfaces and frequencies k_l."""


class Kernels(Protocol):
    """The kernels of a device, for frames of one shape; one thread at a time."""

    # ---- Between the host and the device

    def array(self, values: np.ndarray) -> Array:
        """On the device, contiguous."""

    def numpy(self, values: Array) -> np.ndarray:
        """In NumPy; waits for the kernels that write it."""

    def unpack(self, *listed: Array) -> tuple:
        """NumPy arrays of what `collect` listed: row, col, rank [N]; depth, intensity, std [3, N]; xyz [N, 3]."""

    def as_frame(self, function: Callable) -> Callable:
        """A function of arrays or None, the first [rows, cols], as the device runs frames; a GPU replays it."""

    # ---- A frame of the default method, in order

    def local_mean(self, values: Array, used: Array) -> Array:
        """Means over the used pixels around, σ = LOCAL_SIGMA; 0 in others; float32 [rows, cols] each."""

    def prepare(self, sums: Array, photons: Array, equaliser: Array, used: Array, taken: Array | None = None,
                passed: Array | None = None, mean: Array | None = None) -> tuple[Array, Array]:
        """A frame's `matched` [rows', 2m, cols'] and `counts` [rows', cols'], 0 in masked pixels.

        Args:
            sums: complex [rows, cols, m], Σ_p exp(i ω_l x_p).
            photons, used, taken: float32 [rows, cols]: n; 1, or 0 in masked pixels; background photons to subtract.
            equaliser: complex [rows or 1, cols or 1, m], conj(ĥ_l) with the pixel's delay; 0 masks it.
            passed: complex [rows or 1, cols or 1, m], q_l: a background photon adds q_l · exp(i ω_l x) to z_l.
            mean: complex [m], β_l, the mean of exp(i ω_l x) of the background.
        """

    def no_surfaces(self, frame, surfaces: int) -> Array:
        """Points: none."""

    def search(self, frame, matched: Array, state: Array, layer: int, sigma: float, step: int, enough: float,
               slanted: bool = False) -> None:
        """Give open pixels the surface that one window shows with a score above `enough`.

        Args:
            matched: of the frame, or of `residual`.
            state: points; changed in place.
            layer: index of the surface that is searched for.
            sigma: σ of the window, pixels; 0: every pixel on its own.
            step: pixels along the side of a cell.
            enough: standard deviations.
            slanted: windows along planes, too; for a sigma above 0.
        """

    def turn_planes(self, frame, state: Array) -> None:
        """Turn the planes of first surfaces to what the depths around show, PLANE_TURNS times, in place."""

    def residual(self, frame, state: Array, terms: Array, layer: int) -> Array:
        """`matched` without what the surfaces but `layer` explain."""

    def expand(self, frame, state: Array) -> Array:
        """Terms: the data term of every point to second order, and n, n, g; 0 where there is no point."""

    def birth_death(self, frame, state: Array, terms: Array, max_chi2: float) -> tuple[Array, Array]:
        """The points after each pixel chose among its neighbours' surfaces, and their terms; may replace the arguments.

        `max_chi2`: square of the standard deviations within which depths may be one surface's.
        """

    def log_likelihood_ratio(self, frame, state: Array, terms: Array) -> Array:
        """Of each point's own photons against background alone, nats; float32 [rows', K, cols'], 0 without a point."""

    def pooled_step(self, frame, state: Array, terms: Array, sigma: float, radius: int, fine: int, max_chi2: float
                    ) -> Array:
        """The points after a Gauss-Newton step on their pools.

        Args:
            sigma, radius: of the window, pixels; radius at most MARGIN.
            fine: pixels up to which neighbours count one by one; 1 + 3 i, so that cells begin where it ends.
            max_chi2: as of `birth_death`.
        """

    def drop_weak(self, state: Array, enough: float) -> None:
        """Remove points with a score below `enough`, in place: r = 0."""

    def trim(self, frame, state: Array, terms: Array, enough: float) -> None:
        """Remove edge points not supported by the photons near the edge, in place: r = 0."""

    def drop_ghosts(self, frame, state: Array) -> None:
        """Remove surfaces that a wrong IRF may have left of a pixel's stronger ones, in place; others move up."""

    def drop_blobs(self, frame, state: Array, enough: float) -> None:
        """Remove points without a score of `enough` within the reach of the last window, in place: r = 0."""

    def finalise(self, frame, photons: Array, state: Array, terms: Array, enough: float) -> tuple[Array, Array, Array]:
        """Points with final intensities and standard deviations; photons left, and of the background, [rows, cols].

        `photons` are n, masked pixels included, float32 [rows, cols].
        """

    def background(self, left: Array, exposure: Array) -> Array:
        """Background photons, from the photons that the points leave and g; float32 [rows, cols] each."""

    def unexplained(self, frame, points: Array, rest: Array, taken: Array | None, passed: Array) -> Array:
        """Sums over the pixels of what the points do not explain, float32 [4m + 4] (`Unexplained.unpacked`).

        `points` and `rest` are of `finalise`, `taken` and `passed` as of `prepare`; None: `rest`.
        """

    def collect(self, depth: Array, intensity: Array, std: Array, rays: Array, metres_per_bin: float, metres: float,
                num_bins: int) -> tuple:
        """The list of points for `unpack`, by pixel, the strongest first; xyz = ray · (metres_per_bin · t + metres).

        Depth (bins, [0, T]), intensity (photons; 0: no point) and standard deviation are float32 [rows, K, cols],
        `rays` unit vectors, float32 [rows, cols, 3].
        """

    # ---- Of the baselines. Depth (bins) and intensity (photons; 0: no point) are float32 [rows', K, cols'].

    def match(self, frame, surfaces: int) -> tuple[Array, Array]:
        """Depth, less than a cell outside [0, T], and intensity of the highest peaks of each pixel."""

    def usual_intensity(self, intensity: Array, exposure: Array) -> Array:
        """Mean intensity of the strongest points of the pixels in use; 0 if there is none."""

    def median_depth(self, depth: Array, intensity: Array) -> Array:
        """The median depth of the points, bins; 0 if there is none."""

    def pixelwise(self, frame, table: Array, rate: float, usual: float, depth: Array, intensity: Array,
                  faintest: float = 0.0) -> tuple[Array, Array]:
        """Depth and intensity after a gradient step on each pixel's sketch.

        Args:
            table: float32 [levels, 4, m], a of `sketched.weighted_steps` for shares g r / n from 0 to 1.
            rate: of the full step in depth.
            usual: intensity below which points move less than their curvature allows; 0 for none.
            faintest: points below this intensity are removed after the step.
        """

    def apss(self, depth: Array, intensity: Array, normal: Array | None, enough: Array, scale: float, num_bins: int
             ) -> tuple[Array, Array, Array]:
        """Depth, intensity and normal after a pass of the denoiser, the strongest point of a pixel first.

        Args:
            normal: float32 [2, rows', K, cols'], x and y of unit normals with z > 0; None in the first pass.
            enough: float32 [rows', cols'], of `points_needed`; pixels with 0 get no point.
            scale: bins that count as one pixel.
        """

    def blur(self, values: Array, sigma: float) -> Array:
        """Gaussian sums over the pixels around, 0 outside; float32 [rows, C, cols], σ in pixels."""
