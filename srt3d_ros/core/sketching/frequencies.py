"""Chooses the frequencies of a sketch: those of least expected depth error (docs/algorithm.md), or a user's.

A matched filter on the sketch of one surface errs in two ways: it misses the top of the right peak a little, or takes
another peak. The Ziv–Zakai bound with valley filling has both (J. Ziv and M. Zakai, IEEE Trans. Inf. Theory 15, 1969;
S. Bellini and G. Tartara, IEEE Trans. Commun. 22, 1974), here for the mean absolute error:

    E|t̂ − t| ≥ ∫ max{P(d'): d' ≥ d} dd over 0 < d < T/2,   P(d) = Q(s·D(d) / √(s·V(d) + b·D(d)))

P(d) is the probability that s signal and b background photons favour depth t + d over t. A photon x bins from a
surface responds with q(x) = Σ_l Re conj(ĥ_l) exp(i ω_l x). D(d) = Σ_l |ĥ_l|² (1 − cos ω_l d) is how much more a
signal photon favours the truth on average. The variance of this is b·D(d) from the background and
V(d) = Σ_x h(x) (q(x) − q(x − d))² from each signal photon; for small d, the sandwich variance of the estimator that
`MatchedFrame` serves, not that of an ideal one.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.core.sketching.sums import MAX_SKETCH_SIZE, as_array, check_frequencies
from srt3d_ros.errors import require

DEFAULT_SKETCH_SIZE = 10
FREQUENCIES_FORM = "auto, consecutive or integers such as 1,2,5"
SBRS = (0.1, 1.0, 10.0)     # signal to background ratios that a design is for
SCORES = (7.0, 10.0)        # σ by which the photons exceed the background; the start is sure at 7 (START_SCORE)
BEND = 0.75                 # of the progression: 0 even, 1 geometric
BEND_OF_MANY = 0.5          # for many photons: up to 10 % less depth error; with few photons it loses detections
LEAST_PASSED = 0.1          # |ĥ| that a frequency must have to be the highest
BLIND = 0.01                # |ĥ| below which a frequency says nothing about the depth
LADDER = 1.05               # ratio of successive highest frequencies that are tried
ROOM = 2**0.5               # ratio of highest frequencies, many photons to few, above which a second design pays
ENOUGH = 3.0                # stop trying at this ratio to the best highest frequency so far
LOG_ERROR_SCALE = 0.02      # designs whose log errors differ by less count as about equally good
OVERSAMPLING = 4            # cells of the depth grid per period of the highest frequency
IRFS_COMPARED = 64          # IRFs, of one per pixel, among which the typical one is chosen


def angular_frequencies(frequencies: Sequence[int] | np.ndarray, num_bins: int) -> np.ndarray:
    """ω_l = 2π k_l / T in radians per bin, float64 [m]."""
    return 2 * np.pi * np.asarray(frequencies, dtype=np.float64) / num_bins


def irf_spectrum(sensor: SensorModel, frequencies: Sequence[int] | np.ndarray) -> np.ndarray:
    """ĥ(ω_l) = Σ_b irf[b] exp(i ω_l (b − irf_ref)), complex128 [m], or [pixels, m] if the sensor has an IRF per pixel.

    A return at depth d has the expected sketch ĥ(ω) exp(i ω d).
    """
    phases = np.exp(1j * np.outer(sensor.irf_bins, angular_frequencies(frequencies, sensor.num_bins)))
    return sensor.irf.astype(np.float64) @ phases


def mean_energy(spectrum: np.ndarray) -> np.ndarray:
    """|ĥ|², float64 [m], a mean over the pixels of `irf_spectrum`."""
    return (np.abs(np.atleast_2d(spectrum))**2).mean(axis=0)


def passed_energy(spectrum: np.ndarray, frequencies: tuple[int, ...]) -> np.ndarray:
    """`mean_energy`; InvalidInput if the IRF passes no frequency."""
    energy = mean_energy(spectrum)
    require(energy.max() > BLIND**2, "frequencies", list(frequencies),
            f"some that the sensor's IRF passes (|ĥ| above {BLIND})")
    return energy


def best_frequencies(sensor: SensorModel, sketch_size: int, score: float = 0.0, confirmed: int = 0) -> tuple[int, ...]:
    """The m frequencies, 1 … (T − 1) / 2, of a smooth progression from 1 with the least expected depth error.

    Many photons profit from higher frequencies, up to `confirmed`; `score` and `confirmed` come from `design.measure`.
    Sensors with an IRF per pixel use the most typical one.
    """
    irf = _typical_irf(sensor).tobytes(), sensor.num_bins, sketch_size
    few, most = _design(*irf), score * math.sqrt(sketch_size)
    many = most > SCORES[1] and confirmed > ROOM * few[-1]
    return _design(*irf, most, confirmed, BEND_OF_MANY) if many else few


RULES = {"auto": best_frequencies, "consecutive": lambda _, sketch_size: range(1, sketch_size + 1)}


def choose_frequencies(spec: str | Sequence[int], sensor: SensorModel, sketch_size: int | None = None
                       ) -> tuple[int, ...]:
    """Frequencies from a user's option.

    Args:
        spec: "auto" (`best_frequencies`), "consecutive" (1 … m, as in the paper), or a list such as "1,2,5" or (1, 2).
        sensor: gives T and the IRF.
        sketch_size: m; DEFAULT_SKETCH_SIZE unless given. With a list it must be the list's length, or None.

    Raises:
        InvalidInput: m is too large for T, or the list has an impossible frequency.
    """
    if isinstance(spec, str) and spec in RULES:
        most = max(min((sensor.num_bins - 1) // 2, MAX_SKETCH_SIZE), 1)
        m = min(DEFAULT_SKETCH_SIZE, most) if sketch_size is None else sketch_size
        require(1 <= m <= most, "sketch_size", m, f"1 to {most} for T = {sensor.num_bins} bins")
        return check_frequencies(RULES[spec](sensor, m), sensor.num_bins)
    if isinstance(spec, str):
        parts = spec.split(",")
        require(all(part.strip().isdecimal() for part in parts), "frequencies", spec, FREQUENCIES_FORM)
        spec = [int(part) for part in parts]
    listed = as_array("frequencies", spec, 1, "iuf").tolist()
    require(sketch_size in (None, len(listed)), "sketch_size", sketch_size,
            f"{len(listed)}, the number of frequencies listed (or leave it out)")
    return check_frequencies(listed, sensor.num_bins)


def progression(top: int, sketch_size: int, bend: float = BEND) -> tuple[int, ...]:
    """m increasing integers from 1 to `top` ≥ m, between evenly spaced and geometric.

    k(u) = 1 + (top − 1) · (aᵘ − 1) / (a − 1), a = top^bend, u = 0 … 1; rounded, then raised where two coincide.
    """
    u = np.linspace(0, 1, sketch_size)
    a = float(top)**bend
    chosen: list[int] = []
    for value in 1 + (top - 1) * ((a**u - 1) / (a - 1) if top > 1 else u):
        chosen.append(max(round(value), chosen[-1] + 1 if chosen else 1))
    return tuple(chosen)


def expected_error_bins(spectrum: np.ndarray, num_bins: int, frequencies: Sequence[int], signal: np.ndarray,
                        background: np.ndarray) -> np.ndarray:
    """The bound on E|t̂ − t| (see above) of frequencies k, for several photon counts.

    P(d) is summed on a grid of depths, but for its Gaussian part Q(d / 2σ), σ the sandwich standard deviation: σ may be
    far smaller than a cell, so that part is integrated in closed form, √(2/π) σ. Other peaks are several cells wide.

    Args:
        spectrum: complex [T // 2 + 1], Σ_x h(x) exp(i ω_k x) for k = 0, 1, …
        num_bins: T.
        frequencies: the integers k_l.
        signal, background: expected photons, float [N].

    Returns:
        float64 [N], bins; infinite where the IRF passes none of the frequencies.
    """
    k = np.asarray(frequencies)
    omega = angular_frequencies(k, num_bins)
    curvature = (omega**2 * np.abs(spectrum[k])**2).sum()
    if curvature < 1e-12:
        return np.full(len(signal), np.inf)
    drop, scatter, score_variance = _preferences(spectrum, k, omega)
    s, b = np.asarray(signal, np.float64)[:, None], np.asarray(background, np.float64)[:, None]
    sigma = np.sqrt(np.maximum(s * score_variance + b * curvature / 2, 1e-12)) / (s * curvature)
    step = num_bins / (2 * len(drop))
    distance = np.arange(1, len(drop) + 1) * step
    wrong = _tail(s * drop / np.sqrt(s * scatter + b * drop + 1e-12))           # P(d)
    wrong = np.maximum.accumulate(wrong[:, ::-1], axis=1)[:, ::-1]              # max{P(d'): d' ≥ d}
    beside_gaussian = (wrong - _tail(distance / (2 * sigma))).sum(axis=1) * step
    sigma = sigma[:, 0]
    return np.maximum(np.sqrt(2 / np.pi) * sigma + beside_gaussian, 0.1 * sigma)


def _preferences(spectrum: np.ndarray, k: np.ndarray, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """D(d) and V(d) on the grid of depths 0 < d ≤ T/2, float64 [cells / 2] each; and Σ_x h(x) q′(x)²."""
    cells = 2**int(np.floor(np.log2(OVERSAMPLING * k.max())) + 1)       # above 2 k_max: q² reaches twice as high
    passed, energy = np.conj(spectrum[k]), np.abs(spectrum[k])**2

    def series(coefficients: np.ndarray) -> np.ndarray:
        """Re Σ_l c_l exp(i ω_l x) at every cell."""
        every = np.zeros(cells // 2 + 1, complex)
        every[k] = coefficients
        return np.fft.irfft(every, cells) * cells / 2

    def correlation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Σ_x one(x) other(x − d) for every d."""
        return np.fft.irfft(np.fft.rfft(one) * np.conj(np.fft.rfft(other)), cells)

    q, slope = series(passed), series(1j * omega * passed)
    irf = np.fft.irfft(np.conj(spectrum), cells)                            # share of h in each cell
    products, squares, half = correlation(irf * q, q), correlation(irf, q * q), slice(1, cells // 2 + 1)
    drop = np.maximum(energy.sum() - series(energy)[half], 0)               # rounding may leave less than 0
    scatter = np.maximum(squares[0] - 2 * products[half] + squares[half], 0)
    return drop, scatter, float((irf * slope**2).sum())


def nominal_photons(sketch_size: int, most: float = SCORES[1]) -> tuple[np.ndarray, np.ndarray]:
    """Signal and background photons that a design is for, float [N] each: at each of SBRS, two scores.

    The score s √(2m / (s + b)) is that of an IRF that passes all m frequencies: SCORES[0], then `most`.
    """
    sbr, score = np.repeat(SBRS, 2), np.tile((SCORES[0], most), len(SBRS))
    signal = score**2 * (1 + 1 / sbr) / (2 * sketch_size)
    return signal, signal / sbr


@lru_cache(maxsize=64)
def _design(irf: bytes, num_bins: int, sketch_size: int, most: float = SCORES[1], confirmed: int = MAX_BINS,
            bend: float = BEND) -> tuple[int, ...]:
    spectrum = np.conj(np.fft.rfft(np.frombuffer(irf, np.float32), num_bins))
    passed = np.flatnonzero(np.abs(spectrum[:max((num_bins - 1) // 2, 1) + 1]) >= LEAST_PASSED)
    highest, photons = max(min(int(passed[-1]), confirmed), sketch_size), nominal_photons(sketch_size, most)
    tops, errors, top = [], [], sketch_size
    while top <= highest and (not errors or top <= ENOUGH * tops[int(np.argmin(errors))]):
        tops.append(top)
        errors.append(np.log(expected_error_bins(spectrum, num_bins, progression(top, sketch_size), *photons)).mean())
        top = max(round(top * LADDER), top + 1)
    if not np.isfinite(np.min(errors)):
        return progression(sketch_size, sketch_size)
    # Take the mean of the good tops, not the best: rounding gives one top low side peaks by luck, which tilted surfaces
    # and two depths do not share.
    weights = np.exp((np.min(errors) - np.array(errors)) / LOG_ERROR_SCALE)
    return progression(round(np.exp(np.average(np.log(tops), weights=weights))), sketch_size, bend)


def _typical_irf(sensor: SensorModel) -> np.ndarray:
    """The IRF whose |ĥ| is nearest to the mean over the pixels, float32 [L]; delays do not matter."""
    if sensor.irf.ndim == 1:
        return sensor.irf
    irfs = sensor.irf[np.linspace(0, len(sensor.irf) - 1, min(len(sensor.irf), IRFS_COMPARED)).astype(int)]
    spectra = np.abs(np.fft.rfft(irfs, axis=1))
    return irfs[np.square(spectra - spectra.mean(axis=0)).sum(axis=1).argmin()]


def _tail(z: np.ndarray) -> np.ndarray:
    """Q(z), the probability that a standard normal number exceeds z ≥ 0."""
    return np.vectorize(math.erfc, otypes=[float])(z / math.sqrt(2)) / 2       # importing scipy.special takes longer
