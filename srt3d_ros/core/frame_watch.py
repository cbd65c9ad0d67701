"""FrameWatch: the histogram of all photons of a sensor, now and then, and what it says of the scene."""

from collections import deque

import numpy as np

from srt3d_ros.core.photons import PhotonFrame, PhotonGates, PhotonHistograms, most_photons
from srt3d_ros.core.sensor import SensorModel

LOOK_NS = 500_000_000       # between two frames that are looked at: what enters is seen within a second
LOOKS = 4                   # frames whose histograms add up: 2 s, in which a scene moves and faint parts of it emerge
MOST = 2**20                # photons of a frame that are counted, every n-th of more: 5 ms
# Standard deviations at which bins are not background alone. Of about 400 windows at two looks a second, one deviates
# so much by chance in ten minutes, and only widens what is taken for the scene.
SURE = 4.5


class FrameLooks:
    """Base of what samples frames: a subclass looks at one frame in `every_ns`; the others cost nothing.

    Args:
        sensor: of the photons as they come in.
        every_ns: from one frame that is looked at to the next.
    """

    def __init__(self, sensor: SensorModel, every_ns: int):
        self._sensor, self._every_ns = sensor, every_ns
        self._looked_ns: int | None = None
        self._photons = 0               # of the last look
        self.forget()

    def forget(self) -> None:
        """Begin a new frame."""
        self._open = self._looking = False

    def add(self, frame: PhotonFrame) -> None:
        """See the photons of a frame or packet, before any is dropped; InvalidInput for what is not the sensor's."""
        if not self._open:
            self._open = True
            self._looking = self._looked_ns is None or abs(frame.stamp_ns - self._looked_ns) >= self._every_ns
            if self._looking:
                self._looked_ns = frame.stamp_ns
                self._begin(most_photons(frame, self._photons))
        if self._looking:
            self._look(frame)

    def end_frame(self):
        """End the open frame: what was seen if it was looked at, else None."""
        found = self._end() if self._looking else None
        self.forget()
        return found


class FrameWatch(FrameLooks):
    """Histogram of the newest frames that were looked at: photons by the time at which they came, less their pixel's
    delay; int64 [T], of more than MOST a frame every n-th."""

    def __init__(self, sensor: SensorModel):
        super().__init__(sensor, LOOK_NS)
        self._looks: deque[np.ndarray] = deque(maxlen=LOOKS)

    def _begin(self, most: int) -> None:
        self._counts, self._seen = np.zeros(self._sensor.num_bins, np.int64), 0
        self._step = most // MOST + 1

    def _look(self, frame: PhotonFrame) -> None:
        if isinstance(frame, PhotonHistograms):
            counts = _of_histograms(frame, self._sensor, self._step)
        else:
            counts = np.bincount(_sample(frame, self._sensor, self._step), minlength=len(self._counts))
        self._counts += counts
        self._seen += int(counts.sum()) * self._step if frame.photons is None else frame.photons

    def _end(self) -> np.ndarray:
        self._looks.append(self._counts)
        self._photons = self._seen
        return np.sum(self._looks, axis=0)


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
