"""Which depths a scene occupies, by the histogram of all photons of a frame."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonFrame, PhotonGates, PhotonHistograms, most_photons

MOST = 2**20                # photons that are counted, every n-th of more: 5 ms
# Standard deviations at which bins are not background alone: of 3000 frames one deviates so much by chance, and only
# widens what is taken for the scene.
SURE = 4.5


def histogram(frame: PhotonFrame, sensor: SensorModel) -> np.ndarray:
    """Photons of a frame by the time at which they came, less their pixel's delay; int64 [T], of many every n-th.

    Raises:
        InvalidInput: photons that are not the sensor's.
    """
    step = most_photons(frame) // MOST + 1
    if isinstance(frame, PhotonHistograms):
        return _of_histograms(frame, sensor, step)
    return np.bincount(_sample(frame, sensor, step), minlength=sensor.num_bins)


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


def _sample(frame: PhotonFrame, sensor: SensorModel, step: int) -> np.ndarray:
    """Bins of every `step`-th photon, or of all photons of every `step`-th cycle, of pixels in use, without delay."""
    alike = sensor.mask is None and sensor.delay_bins is None
    if isinstance(frame, PhotonGates):
        words = frame.words[::step].reshape(-1, sensor.pixels)
        seen = words != sensor.gates.no_detection
        pixel = None if alike else np.nonzero(seen)[1]
        bins = words[seen] - np.uint16(sensor.gates.first_word)
    else:
        pixel, bins = frame.pixel[::step], sensor.toa_bins(frame.toa[::step])
    if sensor.mask is not None:
        used = sensor.mask.reshape(-1)[pixel]
        pixel, bins = pixel[used], bins[used]
    if sensor.delay_bins is not None:
        late = np.rint(sensor.delay_bins).astype(np.int64).reshape(-1)
        bins = (bins.astype(np.int64) - late[pixel]) % sensor.num_bins
    return bins


def _of_histograms(frame: PhotonHistograms, sensor: SensorModel, step: int) -> np.ndarray:
    """Counts of every `step`-th pixel in use, without delay; int64 [T], 0 where those subtracted outweigh them."""
    frame.check(sensor)
    counts = frame.on_axis(sensor).reshape(sensor.pixels, -1)[::step]
    if sensor.mask is not None:
        counts = counts * sensor.mask.reshape(-1, 1)[::step]
    if sensor.delay_bins is None:
        total = counts.sum(axis=0, dtype=np.float64)
    else:
        late = np.rint(sensor.delay_bins).astype(np.int64).reshape(-1)[::step]
        total = sum(np.roll(own, -delay) for own, delay in zip(counts.astype(np.float64), late))
    return np.rint(np.maximum(total, 0)).astype(np.int64)


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
