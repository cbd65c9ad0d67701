"""MatchedFrame: a sketch after correction for per-pixel delay and IRF, on which the iterations work."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud, listing
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum, passed_energy
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, PhaseSums, check_frequencies
from srt3d_ros.errors import require
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import OVERLAP
from srt3d_ros.kernels.contract import Array
from srt3d_ros.kernels.devices import kernels_for

MAX_SUM = 1.001 * MAX_PIXEL_PHOTONS       # leaves room for rounding
TABLE_STEPS = 256           # of the background table
CORRECTED = 4               # powers of ω, from 0 on, that a surface may be wrong by: at most m / 2 of them, at least 2
BETWEEN = 8                 # depths between two bins, to average over
WEAKEST_PASSBAND = 0.25     # equalise a pixel's |ĥ| only where it is more than this times the mean of the pixels


@dataclass(frozen=True, eq=False)
class MatchedFrame:
    """The sufficient statistics of Σ_l |sums_l − r ĥ_l exp(i ω_l t)|² for every pixel, and constants of the sensor.

    That data term depends on a pixel's photons only through conj(ĥ_l) · sums_l; the statistics of pixels that see one
    surface add up. A gain g multiplies signal and background photons alike, so it acts as an exposure time.

    Args:
        matched: float32 [rows', 2m, cols'], conj(ĥ_l) · sums_l, real parts before imaginary ones; 0 in masked pixels.
        counts: float32 [rows', cols'], photons; of background alone, twice the variance of each part of
            `matched` / ĥ_l; 0 in masked pixels.
        exposure: float32 [rows', cols'], g; 0 in masked pixels.
        shape: rows, cols, of which the maps have more for padding (`kernels.maps`).
        energy: float32 [m], |ĥ_l|².
        bin_frequencies: float32 [m], k_l / T.
        filters: [cells, 2m], cos(2π k_l c / cells) before sin: the matched filters of `match`, on its grid of depths.
        num_bins: T.
        moments: float32 [4], variance of the depth score by one signal photon, and by one background photon; what the
            width of bins adds to the first; and the mean square error of the depth by bins, bins².
        intensity_moments: float32 [2], variance of the intensity score by one signal and one background photon.
        max_response: the highest response of a photon to a matched filter.
        background_table: float32 [n], for mean responses of 0 … max_response the standard deviations per √photon by
            which they exceed "background alone".
        total_energy: Σ|ĥ_l|², the curvature of the data term in intensity.
        curvature: Σ ω_l² |ĥ_l|², bins⁻²: times r², the curvature of the data term in depth.
        overlap: float32 [3, T], by the distance of two surfaces, c, p and q of `solve_pairs`.
        unlike: float32 [T], by the distance of two surfaces, the part of one that no correction of the other explains.
        clutter: float32 [T], 1 or more: standard deviation of matched filters at each bin, relative to an even
            background.
    """

    matched: Array
    counts: Array
    exposure: Array
    shape: tuple[int, int]
    energy: Array
    bin_frequencies: Array
    filters: Array
    num_bins: int
    moments: Array
    intensity_moments: Array
    max_response: float
    background_table: Array
    total_energy: float
    curvature: float
    overlap: Array
    unlike: Array
    clutter: Array

    @property
    def resolution_bins(self) -> float:
        """Width of the matched filter's peak, bins; closer depths are hardly resolved."""
        return math.sqrt(self.total_energy / self.curvature)


class Matcher:
    """What turns sketches into MatchedFrames: all that depends on sensor and frequencies alone.

    Attributes:
        omega: float64 [m], ω_l, radians per bin.
        equaliser: complex64 [1 or rows, 1 or cols, m]: `matched` is equaliser · sums.
        passed: the same shape: a background photon at bin x adds passed · exp(i ω_l x), whatever the pixel's delay.
        used: float32 [rows, cols], 1, or 0 in masked pixels.
        spectrum, energy: complex [m], float32 [m]: ĥ_l and |ĥ_l|², means over the pixels.
        corrections: of a surface, in `uncorrected`.
        constants: the other fields of a MatchedFrame.

    Raises:
        InvalidInput: impossible frequencies, or the IRF passes none of them.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int]):
        self.sensor, self.frequencies = sensor, check_frequencies(frequencies, sensor.num_bins)
        omega = self.omega = angular_frequencies(self.frequencies, sensor.num_bins)
        spectrum = np.atleast_2d(irf_spectrum(sensor, self.frequencies))               # [1 or pixels, m]
        energy = passed_energy(spectrum, self.frequencies)
        weakest = np.maximum(np.abs(spectrum)**2, energy * WEAKEST_PASSBAND**2)
        equaliser = np.conj(spectrum) * energy / weakest
        self.passed = self._map(equaliser)
        if sensor.delay_bins is not None:
            equaliser = equaliser * np.exp(-1j * np.outer(sensor.delay_bins.reshape(-1), omega))
        if sensor.mask is not None:
            equaliser = equaliser * sensor.mask.reshape(-1, 1)
        self.equaliser, self.used = self._map(equaliser), sensor.used.astype(np.float32)
        self.spectrum, self.energy = spectrum.mean(axis=0), energy.astype(np.float32)
        self.corrections = self._corrections()
        bin_frequencies = (omega / (2 * np.pi)).astype(np.float32)
        moments, intensity_moments = self._score_moments()
        max_response, background_table = self._background_table()
        cells = 16 * math.ceil(max(self.frequencies) / 4)
        turns = np.outer(np.arange(cells), self.frequencies) * (2 * np.pi / cells)
        self.constants = {
            "exposure": maps.pad(sensor.exposure), "shape": sensor.shape, "energy": self.energy,
            "bin_frequencies": bin_frequencies, "filters": np.concatenate([np.cos(turns), np.sin(turns)], axis=1),
            "num_bins": sensor.num_bins, "moments": moments, "intensity_moments": intensity_moments,
            "max_response": max_response, "background_table": background_table,
            "total_energy": float(self.energy.sum()),
            "overlap": self._overlap(), "unlike": self._unlike(),
            "curvature": float((self.energy * (2 * np.pi * bin_frequencies)**2).sum())}

    def check(self, sketch: PhaseSums) -> None:
        """Raise InvalidInput unless it is a Sketch of this size, these frequencies, and sums that photons can give."""
        require(isinstance(sketch, PhaseSums), "seen", type(sketch).__name__, "a Sketch")
        shape = self.sensor.shape
        require(sketch.frequencies == self.frequencies, "sketch frequencies", list(sketch.frequencies),
                f"{list(self.frequencies)}")
        require(sketch.photons.shape == shape, "sketch size", tuple(sketch.photons.shape), f"rows × cols = {shape}")
        parts = np.ascontiguousarray(sketch.sums).view(np.float32)
        longest = float(max(parts.max(), -parts.min()))         # NaN if any number is
        require(longest <= MAX_SUM, "sketch", longest, "sums of unit vectors, as many as photons, everywhere")

    def _map(self, values: np.ndarray) -> np.ndarray:
        """complex [1 or pixels, m] → complex64 [1 or rows, 1 or cols, m]."""
        size = self.sensor.shape if len(values) > 1 else (1, 1)
        return values.astype(np.complex64).reshape(*size, -1)

    def _corrections(self) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal bases [m, n] of what corrections of a surface change, in the real and in the imaginary parts.

        They are |ĥ_l| times 1, i ω_l, ω_l² and i ω_l³, of intensity, depth, width and skew (see `drop_ghosts`).
        """
        root, relative = np.sqrt(self.energy, dtype=float), self.omega / self.omega.max()
        powers = min(max(len(relative) // 2, 2), CORRECTED)
        real, imaginary = (np.linalg.qr(np.stack([root * relative**power for power in range(first, powers, 2)],
                                                 axis=1))[0] for first in (0, 1))
        return real, imaginary

    def _overlap(self) -> np.ndarray:
        """`MatchedFrame.overlap`: OVERLAP times c, p and q at Δ = 0 … T − 1."""
        angles = np.outer(np.arange(self.sensor.num_bins), self.omega)
        total, slope, curvature = (self.energy * self.omega**power for power in range(3))
        cross = np.sin(angles) @ slope / np.sqrt(total.sum() * curvature.sum())
        rows = np.cos(angles) @ total / total.sum(), np.cos(angles) @ curvature / curvature.sum(), cross
        return OVERLAP * np.stack(rows).astype(np.float32)

    def _unlike(self) -> np.ndarray:
        """`MatchedFrame.unlike`: ‖u‖ / ‖ĥ‖ for Δ = 0 … T − 1, u what is left `uncorrected` of |ĥ_l| exp(i ω_l Δ)."""
        root = np.sqrt(self.energy, dtype=float)
        left = uncorrected(root * np.exp(1j * np.outer(np.arange(self.sensor.num_bins), self.omega)), self.corrections)
        return (np.linalg.norm(left, axis=1) / np.linalg.norm(root)).astype(np.float32)

    def _score_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """`MatchedFrame.moments` and `intensity_moments`: variances that each expected photon adds to the scores.

        The scores are Σ_l ω_l Im and Σ_l Re of conj(ĥ_l) exp(i ω_l b) for a photon b bins from its surface: the
        gradients of the data term in t and r. For Poisson numbers of photons, each expected one adds the mean square of
        its score, over the IRF or over all bins. The sandwich formula turns that into the variances of the estimates,
        for any distribution of the photons over the bins.

        Between bins the (mean) IRF counts as linear, so pulses narrower than a bin look wider there; means over BETWEEN
        depths tell how much.
        """
        irf, omega, energy = self.sensor.mean_irf, self.omega, self.energy
        bins, depths = np.arange(len(irf) + 1) + self.sensor.irf_bins[0], np.arange(BETWEEN) / BETWEEN
        response = np.exp(1j * (bins - depths[:, None])[..., None] * omega) * np.conj(self.spectrum)
        of_depth, of_intensity = np.imag(response * omega).sum(axis=2), np.real(response[0]).sum(axis=1)
        shown = np.outer(1 - depths, np.append(irf, 0)) + np.outer(depths, np.append(0, irf))
        mean, square = (shown * of_depth).sum(axis=1), (shown * of_depth**2).sum(axis=1)
        curvature = (omega**2 * energy).sum()
        return (np.array([square[0], curvature / 2, max((square - mean**2).mean() - square[0], 0),
                          (mean**2).mean() / curvature**2], np.float32),
                np.array([irf @ of_intensity[:-1]**2, energy.sum() / 2], np.float32))

    def _background_table(self) -> tuple[float, np.ndarray]:
        """`MatchedFrame.max_response` and `background_table`: √(2 I(u)) for u from 0 to the greatest response.

        The mean response of n background photons reaches u with probability exp(−n I(u)) at most,
        I(u) = max_λ λu − K(λ), where K(λ) is the logarithm of the mean of exp(λ · response) over all bins (Chernoff's
        bound). That is u / √(Σ|ĥ_l|² / 2) for small u, as for a normal distribution, and far less for large u, because
        a few photons often agree by chance.
        """
        cells = 16 * max(self.frequencies)
        coefficients = np.zeros(cells // 2 + 1, complex)
        coefficients[list(self.frequencies)] = np.conj(self.spectrum) / 2
        response = np.fft.irfft(coefficients, cells) * cells        # Re Σ conj(ĥ_l) exp(i ω_l b) over all bins
        greatest = response.max()
        known, table = [0.0], [0.0]
        for tilt in np.geomspace(1e-3, 100, 200) / greatest:        # one by one, to bound memory
            weights = np.exp(tilt * (response - greatest))
            known.append(weights @ response / weights.sum())
            table.append(math.sqrt(2 * (tilt * (known[-1] - greatest) - math.log(weights.mean()))))
        return float(greatest), np.interp(np.linspace(0, greatest, TABLE_STEPS + 1), known, table).astype(np.float32)


class SensorOnDevice:
    """One sensor's arrays on a device: matches sketches there and lists points.

    Attributes:
        kernels: those of the device, for frames of the sensor with `surfaces` a pixel.
        passed: `Matcher.passed`.
    """

    def __init__(self, matcher: Matcher, device: str, surfaces: int):
        sensor = self._sensor = matcher.sensor
        kernels = self.kernels = kernels_for(device).for_shape(*sensor.shape, surfaces, matcher.frequencies)
        self._constants = {name: kernels.array(value) if isinstance(value, np.ndarray) else value
                           for name, value in matcher.constants.items()}
        self.passed, self._equaliser = kernels.array(matcher.passed), kernels.array(matcher.equaliser)
        self._used, self._even = kernels.array(matcher.used), kernels.array(np.ones(sensor.num_bins, np.float32))
        rays, *self._scale = listing(sensor)
        self._rays = kernels.array(rays)

    def match(self, photons: Array, sums: Array, exposure: Array | None = None, background: Array | None = None,
              mean: Array | None = None, clutter: Array | None = None) -> tuple[MatchedFrame, Array | None]:
        """The MatchedFrame of a sketch, and the background photons that were taken out of it, or None.

        `exposure` is that of the MatchedFrame; None: the sensor's. The last three arguments are those of
        `background.RemovedBackground`.
        """
        taken = None if background is None else self.kernels.local_mean(background, self._used)
        matched, counts = self.kernels.prepare(sums, photons, self._equaliser, self._used, taken, self.passed, mean)
        clutter = self._even if clutter is None else clutter
        constants = self._constants if exposure is None else self._constants | {"exposure": exposure}
        return MatchedFrame(matched, counts, clutter=clutter, **constants), taken

    def listed(self, depth: Array, intensity: Array, std: Array) -> tuple:
        """The list of points, for `unpack`, of `kernels.collect`."""
        return self.kernels.collect(depth, intensity, std, self._rays, *self._scale)

    def cloud(self, listed: Sequence[Array], background: Array, sketch: PhaseSums) -> PointCloud:
        """The cloud of a sketch's listed points and background, off the device, with the photons of one frame."""
        background = self.kernels.numpy(background) / sketch.frames
        return PointCloud.of_list(self._sensor, self.kernels.unpack(*listed), background, sketch.stamp_ns)


def uncorrected(values: np.ndarray, bases: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """What is left of values over |ĥ_l|, complex [..., m], once a surface is corrected by least squares."""
    real, imaginary = (part - part @ basis @ basis.T for part, basis in zip((np.real(values), np.imag(values)), bases))
    return real + 1j * imaginary
