"""Gate and frequencies of a sketch from a user's options; the gate "auto" surrounds what a histogram shows."""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypedDict

import numpy as np

from srt3d_ros.core.keys import Key, keys
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.pulse import equivalent_width
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import (
    DEFAULT_SKETCH_SIZE,
    FREQUENCIES_FORM,
    RULES,
    best_frequencies,
    choose_frequencies,
    irf_spectrum,
    mean_energy,
    passed_energy,
    progression,
)
from srt3d_ros.core.sketching.gate import AUTO, FORM, OFF, Gate, parse
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonHistograms
from srt3d_ros.core.sketching.plausibility import emptiest_quarter, window_sums
from srt3d_ros.core.sketching.sums import MAX_SKETCH_SIZE
from srt3d_ros.errors import InvalidInput

OCCUPIED_SIGMAS = 4.5       # σ at which bins hold more than background; exceeded by chance in one of 3000 frames
GATE_MARGIN = 1 / 8     # of the occupied bins, per side. Art, SBR 0.1: TD 92.2 % (0: 92.2, 1/2: 91.5, no gate: 88.0)
WORTHWHILE = 1 / 10     # of the photons; a gate that drops fewer costs TD: 0.1 points at SBR 52 and 1 photon a pixel
RUNGS = 20              # frequencies at which photons and IRF are compared
POOLED_PIXELS = 4       # pixels that count as one: a reconstruction pools the photons around each point
MOST_OFF = 0.08         # relative difference of |ĥ|² by photons and by IRF; higher frequencies add to the depth error
HIGHER = 4              # frequencies for many photons reach at most so many times the highest one for few


class SketchOptions(TypedDict, total=False):
    """How to sketch."""

    sketch_size: Annotated[int | None, Key("complex numbers per pixel (m), unless frequencies lists them",
                                           bounds=(1, MAX_SKETCH_SIZE), default=DEFAULT_SKETCH_SIZE)]
    frequencies: Annotated[str | Sequence[int], Key(
        "frequencies to keep. auto: those with the least expected depth error for the IRF. consecutive: 1 to "
        "sketch_size, as in the paper. Or a list", form=FREQUENCIES_FORM, default="auto")]
    gate: Annotated[str | tuple[int, int], Key(
        "first and last depth bin to keep. Photons in other bins are dropped, and T becomes the gate's length: less "
        "background and finer depths at a low SBR. auto, for files: the bins whose photons show a scene", form=FORM,
        default=OFF)]


OPTIONS = keys(SketchOptions)


class SketchDesign(NamedTuple):
    """A gate or None, and the integers k_l for the T that it leaves."""

    gate: Gate | None
    frequencies: tuple[int, ...]


def design_sketch(sensor: SensorModel, gate: str | tuple[int, int] = OFF, frequencies: str | Sequence[int] = "auto",
                  sketch_size: int | None = None, frame: PhotonEvents | PhotonHistograms | None = None) -> SketchDesign:
    """The design for a sensor.

    Args:
        gate, frequencies, sketch_size: see `SketchOptions`; "auto" follows the photons of `frame`.

    Raises:
        InvalidInput: gate, frequencies or photons do not fit the sensor, its IRF passes none, or auto has no frame.
    """
    bins = parse(gate)
    if bins == AUTO:
        if frame is None:
            raise InvalidInput("gate", gate, FORM)
        chosen = choose_frequencies(frequencies, sensor, sketch_size)
        is_rule = isinstance(frequencies, str) and frequencies in RULES
        highest = len(chosen) if is_rule else max(chosen)       # rules choose again for the gate's T
        bins = _bins_of(histogram(frame, sensor), sensor, 2 * highest + 1)
    kept = None if isinstance(bins, str) else Gate(sensor, *bins)
    within = sensor if kept is None else kept.sensor
    chosen = choose_frequencies(frequencies, within, sketch_size)
    if isinstance(frequencies, str) and frequencies == AUTO and frame is not None:
        highest = min(HIGHER * chosen[-1], max((within.num_bins - 1) // 2, 1))
        chosen = best_frequencies(within, len(chosen), *measure(frame, sensor, kept, highest))
    passed_energy(irf_spectrum(within, chosen), chosen)
    return SketchDesign(kept, chosen)


def measure(frame: PhotonFrame, sensor: SensorModel, gate: Gate | None, highest: int) -> tuple[float, int]:
    """How much signal the photons in the gate have, and up to which frequency they agree with the IRF.

    The distance of two signal photons of a pixel is that of two draws of the IRF, at any depth; a background photon
    lies anywhere. So the mean of cos ω(x − x') over pairs of a pixel's photons is p² |ĥ(ω)|², p the share of signal. A
    sketch has the sum over pairs, |Σ_x exp(i ω x)|² = n + 2 Σ cos ω(x − x'): depth and background need not be known.

    Returns:
        The score p √(2n) of the n photons of POOLED_PIXELS, and the highest frequency at which photons and IRF agree.
    """
    sketch = sketch_photons(frame, sensor, progression(highest, min(RUNGS, highest)), gate)
    within = sketch.sensor
    passed = mean_energy(irf_spectrum(within, sketch.frequencies))
    passed *= np.sinc(np.array(sketch.frequencies) / within.num_bins)       # depths lie between bins
    several = (sketch.photons > 1) & sensor.used
    n = sketch.photons[several].astype(np.float64)[:, None]
    # Divide by n − 1: each pixel then counts by its photons, not by its pairs.
    pairs = ((np.abs(sketch.sums[several])**2 - n) / (n - 1)).sum(axis=0) / max(n.sum(), 1)
    error = np.sqrt((n / (n - 1)).sum()) / max(n.sum(), 1)
    share2 = max(pairs @ passed / (passed @ passed), 1e-12)
    wrong = np.append(np.abs(pairs / share2 - passed) + error / share2 > MOST_OFF * passed, True)
    score = np.sqrt(2 * POOLED_PIXELS * min(share2, 1) * sketch.photons.mean(where=sensor.used))
    return float(score), (0, *sketch.frequencies)[wrong.argmax()]


def histogram(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel) -> np.ndarray:
    """Photons of all unmasked pixels in each bin, without the pixels' delays; int64 [T], negative sums as 0.

    Raises InvalidInput if the photons do not fit the sensor.
    """
    frame.check(sensor)
    late, used = np.rint(sensor.late).astype(np.int64).reshape(-1), sensor.used.reshape(-1)
    if isinstance(frame, PhotonEvents):
        kept = used[frame.pixel]
        bins = sensor.toa_bins(frame.toa[kept]).astype(np.int64) - late[frame.pixel[kept]]
        return np.bincount(bins % sensor.num_bins, minlength=sensor.num_bins)
    counts, total = frame.on_axis(sensor).reshape(sensor.pixels, -1), np.zeros(sensor.num_bins)
    for delay in np.unique(late):
        of_pixels = (used & (late == delay))[:, None]
        total += np.roll(counts.sum(axis=0, dtype=np.float64, where=of_pixels), -delay)
    return np.rint(np.maximum(total, 0)).astype(np.int64)


def occupied(counts: np.ndarray, least_bins: int) -> tuple[int, int] | None:
    """The first and the last bin of a histogram [T] above the level of its emptiest quarter; None if none is.

    The quarter gives the level of an even background. Other backgrounds, such as fog, count as part of the scene.

    Windows of `least_bins`, about the width of a pulse, and of twice, four times, … as many outside of what was found,
    are tested by the likelihood ratio of two Poisson numbers (T.-P. Li & Y.-Q. Ma, ApJ 272, 1983, eq. 17). It holds
    for few photons, and includes the uncertainty of the level.
    """
    quarter = max(len(counts) // 4, 1)
    off = int(window_sums(counts, quarter).min())
    first, last = len(counts), -1
    width = least_bins
    while width <= quarter:
        sure = np.flatnonzero(_deviations(window_sums(counts, width), off, width / quarter) > OCCUPIED_SIGMAS)
        beside = sure[(sure + width <= first) | (sure > last)]
        if len(beside):
            first, last = min(first, int(beside[0])), max(last, int(beside[-1]) + width - 1)
        width *= 2
    return (first, last) if last >= 0 else None


def signal_to_background(counts: np.ndarray, sensor: SensorModel) -> float:
    """SBR of a histogram [T] whose emptiest quarter is background alone; 0 if nothing stands out."""
    if occupied(counts, _pulse_bins(sensor)) is None:
        return 0.0
    background = counts[emptiest_quarter(counts)].mean() * len(counts)
    return float(counts.sum() / background - 1) if background > 0 else np.inf


def _bins_of(counts: np.ndarray, sensor: SensorModel, least: int) -> tuple[int, int] | str:
    """The occupied bins and a margin, at least `least` bins and the IRF's length; OFF if that drops few photons."""
    pulse, most = _pulse_bins(sensor), sensor.num_bins - 1
    bins = occupied(counts, pulse)
    if bins is None:
        return OFF
    first, last = bins
    length = last - first + 1
    least = max(sensor.irf.shape[-1], least)
    margin = max(pulse, round(GATE_MARGIN * length), math.ceil((least - length) / 2))
    first, last = max(min(first - margin, most + 1 - least), 0), min(max(last + margin, least - 1), most)
    inside = counts[first:last + 1].sum() / counts.sum()
    return (first, last) if last - first + 1 >= least and inside <= 1 - WORTHWHILE else OFF


def _pulse_bins(sensor: SensorModel) -> int:
    """The equivalent width of the mean IRF, whole bins."""
    return max(round(equivalent_width(sensor)), 1)


def _deviations(on: np.ndarray, off: int, share: float) -> np.ndarray:
    """By how many standard deviations `on` exceeds its expectation `share` · `off`; 0 if it does not."""
    both = np.maximum(on + off, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        nats = np.where(on > 0, on * np.log((1 + share) / share * on / both), 0.0)
        if off:
            nats = nats + off * np.log((1 + share) * off / both)
    return np.where(on > share * off, np.sqrt(2 * np.maximum(nats, 0)), 0.0)
