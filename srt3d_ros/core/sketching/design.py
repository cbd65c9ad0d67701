"""The gate and the frequencies of a sketch, from what a user writes; the gate "auto" is where a frame shows a scene."""

from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import RULES, choose, design
from srt3d_ros.core.sketching.gate import AUTO, FORM, OFF, Gate, parse
from srt3d_ros.core.sketching.light import measure
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.errors import require

SURE = 4.5              # σ at which bins are more than background; one of 3000 frames deviates so much by chance
MARGIN = 1 / 8          # of what is seen, on each side; Art, SBR 0.1: TD 92.2 % (0: 92.2, 1/2: 91.5, no gate: 88.0)
WORTHWHILE = 1 / 10     # of the photons that a gate drops at least: TD falls by 0.1 points at SBR 52, 1 photon a pixel
REACH = 4               # times the highest frequency of "auto" for few photons, that one for many may have


class SketchDesign(NamedTuple):
    """A gate or None, and the integers k_l for the T that it leaves."""

    gate: Gate | None
    frequencies: tuple[int, ...]


def design_for(sensor: SensorModel, gate: str | tuple[int, int] = OFF, frequencies: str = "auto",
               sketch_size: int | None = None, frame: PhotonEvents | PhotonHistograms | None = None) -> SketchDesign:
    """The design for a sensor.

    Args:
        gate: off, the first and the last bin, or auto: around the depths that stand out in the histogram of `frame`.
        frequencies, sketch_size: as of `choose`; "auto" follows the photons of `frame`.

    Raises:
        InvalidInput: a gate, frequencies or photons that do not fit the sensor, or auto without a frame.
    """
    bins = parse(gate)
    if bins == AUTO:
        require(frame is not None, "gate", gate, FORM)
        chosen = choose(frequencies, sensor, sketch_size)
        highest = len(chosen) if frequencies in RULES else max(chosen)          # the others follow T
        bins = _bins_of(histogram(frame, sensor), sensor, 2 * highest + 1)
    found = None if bins == OFF else Gate(sensor, *bins)
    within = sensor if found is None else found.sensor
    chosen = choose(frequencies, within, sketch_size)
    if frequencies == AUTO and frame is not None:
        highest = min(REACH * chosen[-1], max((within.num_bins - 1) // 2, 1))
        chosen = design(within, len(chosen), *measure(frame, sensor, found, highest))
    return SketchDesign(found, chosen)


def histogram(frame: PhotonEvents | PhotonHistograms, sensor: SensorModel) -> np.ndarray:
    """Photons of the pixels in use by the bin in which they came, less their pixel's delay; int64 [T].

    0 where the counts that were subtracted outweigh the photons. Raises InvalidInput for photons of another sensor.
    """
    frame.check(sensor)
    late, used = np.zeros(sensor.pixels, np.int64), np.ones(sensor.pixels, bool)
    if sensor.delay_bins is not None:
        late = np.rint(sensor.delay_bins).astype(np.int64).reshape(-1)
    if sensor.mask is not None:
        used = sensor.mask.reshape(-1)
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
    """The first and the last bin of a histogram [T] that show more than its emptiest quarter does; None if none does.

    That quarter shows the level of an even background, and less of another: fog is taken for a part of the scene.

    Windows of `least_bins`, about the width of a pulse, and then of twice, four times, … as many, beside what
    narrower ones have found, are tested by the likelihood ratio of two Poisson numbers (T.-P. Li & Y.-Q. Ma, ApJ
    272, 1983, eq. 17), which holds for few photons too and knows how well the level is known.
    """
    quarter = max(len(counts) // 4, 1)
    off = int(_sums(counts, quarter).min())
    first, last = len(counts), -1
    width = least_bins
    while width <= quarter:
        sure = np.flatnonzero(_deviations(_sums(counts, width), off, width / quarter) > SURE)
        beside = sure[(sure + width <= first) | (sure > last)]
        if len(beside):
            first, last = min(first, int(beside[0])), max(last, int(beside[-1]) + width - 1)
        width *= 2
    return (first, last) if last >= 0 else None


def signal_to_background(counts: np.ndarray, sensor: SensorModel) -> float:
    """SBR by a histogram [T] whose emptiest quarter shows background alone; 0 if nothing stands out of it."""
    if occupied(counts, _pulse_bins(sensor)) is None:
        return 0.0
    quarter = max(len(counts) // 4, 1)
    background = _sums(counts, quarter).min() / quarter * len(counts)
    return float(counts.sum() / background - 1) if background > 0 else np.inf


def _bins_of(counts: np.ndarray, sensor: SensorModel, least: int) -> tuple[int, int] | str:
    """What a histogram shows and a margin, of `least` bins or more and the IRF's length; OFF if it drops little."""
    pulse, most = _pulse_bins(sensor), sensor.num_bins - 1
    seen = occupied(counts, pulse)
    if seen is None:
        return OFF
    first, last = seen
    least = max(sensor.irf.shape[-1], least)
    margin = max(pulse, round(MARGIN * (last - first + 1)), -(-(least - (last - first + 1)) // 2))
    first, last = max(min(first - margin, most + 1 - least), 0), min(max(last + margin, least - 1), most)
    inside = counts[first:last + 1].sum() / counts.sum()
    return (first, last) if last - first + 1 >= least and inside <= 1 - WORTHWHILE else OFF


def _pulse_bins(sensor: SensorModel) -> int:
    """The equivalent width of the mean IRF, 1 / Σ h², bins."""
    return max(round(1 / float(np.square(np.atleast_2d(sensor.irf).mean(axis=0)).sum())), 1)


def _sums(counts: np.ndarray, width: int) -> np.ndarray:
    """Photons of every `width` bins that follow each other."""
    total = np.concatenate([[0], np.cumsum(counts)])
    return total[width:] - total[:-width]


def _deviations(on: np.ndarray, off: int, share: float) -> np.ndarray:
    """By how many standard deviations `on` photons exceed the share of `off` that chance would bring; 0 if less."""
    both = np.maximum(on + off, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        nats = np.where(on > 0, on * np.log((1 + share) / share * on / both), 0.0)
        if off:
            nats = nats + off * np.log((1 + share) * off / both)
    return np.where(on > share * off, np.sqrt(2 * np.maximum(nats, 0)), 0.0)
