"""Instrument response functions (IRFs): computed, or estimated from photons."""

import math

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.plausibility import floor_of
from srt3d_ros.datasets.values import Note
from srt3d_ros.errors import InvalidInput, require

SMOOTHING = 0.25, 0.5, 0.25
SMOOTH_NOISE = math.hypot(*SMOOTHING)
NOISE_SIGMAS = 3.0      # above the floor: still pulse
PULSE_ABOVE = 0.01      # of the peak
ESTIMATED = Note("IRF estimated from the photons, so it is slightly too wide: give irf (--irf)", "irf")
GUESSED = Note("IRF taken to be one bin: none can be seen in the photons, give irf (--irf)", "irf")
WRONG_TAIL = Note("the IRF's tail is before its peak: if times run backwards, give reversed (--reversed); if only the "
                  "IRF's do, reverse it", "irf")
TAIL_ENDS, TAIL_RATIO = 0.05, 1.5       # of the peak; of the bins from the peak to there
# Constants of `estimate`.
PHOTONS_USED = 100_000
FEWEST_PHOTONS = 3          # a pixel with fewer tells nothing about the IRF
STANDS_OUT = 1.5            # cluster score over that of uniform photons, at least; background alone has 0.98 to 1.03
SHIFTS = 16                 # depths tried on either side of a cluster's centre
MOST_WIDTHS = 10            # longest half of an estimated IRF, in cluster widths
ROUNDS = 8
STRAY_LIKELIHOOD = 1e-2     # likelihood of a photon anywhere, so that one outlier does not exclude a depth
KEEP_ABOVE = 0.003          # of the peak; the IRF is cut where it falls below


def spad(bin_width_s: float, fwhm_s: float = 55e-12, tail_s: float = 100e-12, tail_share: float = 0.3) -> np.ndarray:
    """IRF of a SPAD: a Gaussian (laser, jitter), of which `tail_share` is delayed by an exponential diffusion tail.

    Args:
        bin_width_s, fwhm_s, tail_s: seconds; full width at half maximum of the Gaussian, 1/e time of the tail.

    Returns:
        float32 [L], sum 1, cut where it falls below 10⁻⁴ of its peak.
    """
    fine = 8                                            # steps a bin, to integrate narrow IRFs well
    step_s = bin_width_s / fine
    sigma_s = fwhm_s / np.sqrt(8 * np.log(2))
    lead = int(np.ceil(5 * sigma_s / bin_width_s)) * fine
    time_s = np.arange(-lead, int(np.ceil((5 * sigma_s + 12 * tail_s) / bin_width_s)) * fine) * step_s
    gauss = np.exp(-0.5 * (time_s / sigma_s) ** 2)
    decay = np.exp(-np.arange(len(time_s)) * step_s / tail_s)
    tail = np.convolve(gauss, decay / decay.sum())[: len(time_s)]
    bins = ((1 - tail_share) * gauss + tail_share * tail).reshape(-1, fine).sum(axis=1)
    seen = np.flatnonzero(bins > 1e-4 * bins.max())
    bins = bins[seen[0]: seen[-1] + 1]
    return (bins / bins.sum()).astype(np.float32)


def gaussian(sigma_bins: float) -> np.ndarray:
    """A Gaussian of this standard deviation in bins, cut at 4 of them; float64 [L]."""
    require(0 < sigma_bins < MAX_BINS / 8, "irf_sigma_bins", sigma_bins, "bins, above 0")
    reach = int(np.ceil(4 * sigma_bins))
    return np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_bins) ** 2)


def checked(irf: np.ndarray, ref: int | None) -> tuple[np.ndarray, tuple[Note, ...]]:
    """A measured IRF [L] or [pixels, L] without its floor, and notes on the floor and on a peak far from the start.

    The floor, of dark counts or ambient light, is the level at the darker end of the IRF if that is flat. The pulse
    ends where noise hides it.

    Args:
        ref: its irf_ref, if known.
    """
    mean, notes, end = np.atleast_2d(irf).mean(axis=0), (), floor_of(irf)
    peak = int(np.argmax(mean))
    if end is not None:
        floor, noise = end.mean(), np.atleast_2d(end).mean(axis=0).std() * SMOOTH_NOISE
        pulse = _around(peak, _smooth(mean) - floor > NOISE_SIGMAS * noise)
        clean = np.zeros_like(irf)
        clean[..., pulse] = np.maximum(irf - end.mean(axis=-1, keepdims=True), 0)[..., pulse]
        notes += Note(f"the IRF's floor (dark counts), {floor / mean[peak]:.2g} of its peak, was taken off", "irf"),
        irf, mean = clean, np.atleast_2d(clean).mean(axis=0)
    pulse = np.flatnonzero(mean >= PULSE_ABOVE * mean[peak])
    if ref is None and mean[peak] > 0 and pulse[0] > np.ptp(pulse) + 1:
        notes += Note(f"the IRF peaks in its bin {peak}, which is taken to mark the depth: if it was recorded at range "
                      "0 on the time axis of the data, give irf_ref=0 (--irf-ref 0)", "irf_ref"),
    return irf, notes


def estimate(events: PhotonEvents, num_bins: int) -> np.ndarray:
    """Estimate the IRF from one frame, with an unknown depth for each pixel; float64 [L], slightly too broad.

    The photons of a pixel cluster around its strongest surface. Expectation–maximisation over the pixels' depths: each
    photon votes for the IRF bin it falls into, weighted by how well the other photons of its pixel agree with that
    depth (its own vote would sharpen the estimate). Then the baseline is subtracted.

    Raises:
        InvalidInput: the photons do not cluster.
    """
    pixel, toa = _fullest_pixels(events)
    require(len(pixel) > 0, "photons", problem="Too few photons to estimate the IRF: give irf.")
    centre, width, score = _clusters(pixel, toa, num_bins)
    anywhere = np.random.default_rng(0).integers(0, num_bins, len(toa))
    by_chance = _clusters(pixel, anywhere[np.lexsort((anywhere, pixel))], num_bins)[2]
    require(score > STANDS_OUT * by_chance, "photons",
            problem="The photons are spread like background, so the IRF cannot be estimated: give irf; of "
                    "an array whose axes are in another order, axes (--axes).")
    reach = min(MOST_WIDTHS * width, (num_bins - 1) // 4)
    near = np.abs(toa - centre) <= reach
    pixel, lag = pixel[near], (toa - centre)[near]
    start = np.flatnonzero(np.diff(pixel, prepend=-1))
    counts = np.diff(start, append=len(pixel))
    step = math.ceil(width / SHIFTS)
    shifts = step * np.arange(-SHIFTS, SHIFTS + 1)
    middle = reach + step * SHIFTS
    at = lag[:, None] - shifts + middle                     # IRF bin of each photon at each shift
    irf = np.exp(-0.5 * (np.arange(-middle, middle + 1) / (0.4 * width + 0.5)) ** 2)
    for _ in range(ROUNDS):
        score = np.log(irf / irf.sum() + STRAY_LIKELIHOOD / len(irf)).astype(np.float32)[at]
        others = np.repeat(np.add.reduceat(score, start), counts, axis=0) - score
        votes = np.exp(others - others.max(axis=1, keepdims=True))
        votes /= votes.sum(axis=1, keepdims=True)
        irf = np.bincount(at.ravel(), votes.ravel(), minlength=len(irf))
        irf = np.roll(irf, middle - int(np.argmax(_smooth(irf))))
    return _cut_out(irf[middle - reach: middle + reach + 1])


def tail_note(sensor: SensorModel) -> tuple[str, ...]:
    """A note if the IRF rises more slowly than it falls: a laser's pulse and a SPAD's diffusion do the opposite."""
    mean = np.pad(_smooth(sensor.mean_irf), 1)
    peak, low = int(mean.argmax()), TAIL_ENDS * mean.max()
    rise, fall = int(np.argmax(mean[peak::-1] <= low)), int(np.argmax(mean[peak:] <= low))
    return (WRONG_TAIL,) if rise > TAIL_RATIO * fall + 1 else ()


def estimated(events: PhotonEvents, num_bins: int, guess: bool = False) -> tuple[np.ndarray, str]:
    """The estimated IRF and a note. If the photons show none: one bin if `guess`, else InvalidInput."""
    try:
        return estimate(events, num_bins), ESTIMATED
    except InvalidInput:
        if not guess:
            raise
        return np.ones(1), GUESSED


def _fullest_pixels(events: PhotonEvents) -> tuple[np.ndarray, np.ndarray]:
    """About PHOTONS_USED photons of the fullest pixels, sorted by pixel and ToA; int64 each."""
    counts = np.bincount(events.pixel)
    by_count = np.argsort(-counts, kind="stable")
    enough = np.searchsorted(np.cumsum(counts[by_count]), PHOTONS_USED) + 1
    use = np.zeros(len(counts), bool)
    use[by_count[:enough]] = True
    use &= counts >= FEWEST_PHOTONS
    kept = use[events.pixel]
    pixel, toa = events.pixel[kept].astype(np.int64), events.toa[kept].astype(np.int64)
    order = np.lexsort((toa, pixel))[::max(len(pixel) // PHOTONS_USED, 1)]
    return pixel[order], toa[order]


def _clusters(pixel: np.ndarray, toa: np.ndarray, num_bins: int) -> tuple[np.ndarray, int, float]:
    """For each photon the centre of its pixel's densest window; the windows' common width; their score.

    The width is the one whose windows stand out most from a uniform background (a scan statistic).
    """
    total = np.bincount(pixel)[pixel]
    line = pixel * (4 * num_bins) + toa                     # far apart, so that no window reaches the next pixel
    start = np.flatnonzero(np.diff(pixel, prepend=-1))
    best = (toa, 1, -np.inf)
    width = 1.0
    while width < max(num_bins / 8, 2):
        bins = int(width)
        inside = np.searchsorted(line, line + bins) - np.arange(len(line))      # photons in [toa, toa + bins)
        stands_out = inside * np.log(inside * num_bins / (total * bins))
        score = np.maximum.reduceat(stands_out, start).sum()
        if score > best[2]:
            first = _argmax_of_runs(inside, start)
            sums = np.concatenate([[0], np.cumsum(toa)])
            mean = (sums[first + inside[first]] - sums[first]) / inside[first]
            centre = np.repeat(np.rint(mean).astype(np.int64), np.diff(start, append=len(line)))
            best = (centre, bins, float(score))
        width = max(width + 1, width * 1.25)
    return best


def _argmax_of_runs(values: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Index of the first maximum of each run; runs begin at `start`."""
    largest = np.repeat(np.maximum.reduceat(values, start), np.diff(start, append=len(values)))
    candidate = np.where(values == largest, np.arange(len(values)), len(values))
    return np.minimum.reduceat(candidate, start)


def _cut_out(irf: np.ndarray) -> np.ndarray:
    """The IRF around its peak in the middle, without baseline, cut where it falls to KEEP_ABOVE of the peak."""
    edge = max(len(irf) // 8, 1)
    baseline = np.median(np.concatenate([irf[:edge], irf[-edge:]]))
    peak = len(irf) // 2
    smooth = _smooth(irf)
    kept = _around(peak, smooth - baseline > KEEP_ABOVE * (smooth[peak] - baseline))
    return np.maximum(irf[kept] - baseline, 0)


def _around(peak: int, high: np.ndarray) -> slice:
    """The bins around the peak up to the first ones that are not high."""
    before, after = np.flatnonzero(~high[:peak]), np.flatnonzero(~high[peak:])
    return slice(before[-1] + 1 if before.size else 0, peak + after[0] if after.size else len(high))


def _smooth(irf: np.ndarray) -> np.ndarray:
    return np.convolve(irf, SMOOTHING, mode="same")
