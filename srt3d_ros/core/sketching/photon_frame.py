"""PhotonFrame: the photons of one frame, as events, as the gates of a SPAD array, or as histograms."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import require

CHUNK = 2**16           # counts of at most 16 bits whose sum fits into 32 bits
TOA_DTYPES = (np.uint16, np.float32)
MAX_OF_PIXEL = 2**32    # photons in a pixel's histogram: keeps sums of phases and counts within their integers
COUNT_DTYPES = (np.uint8, np.uint16, np.int32, np.float32)


@dataclass(frozen=True, eq=False)
class PhotonEvents:
    """One entry per detected photon, in any order.

    Args:
        pixel: uint32 [N], row · cols + col.
        toa: uint16 or float32 [N], time of arrival in bins, 0 ≤ toa < T; 5.0 is the centre of bin 5.
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock.
    """

    pixel: np.ndarray
    toa: np.ndarray
    stamp_ns: int = 0

    def __post_init__(self):
        require(self.toa.dtype in TOA_DTYPES, "toa dtype", str(self.toa.dtype), "uint16 or float32")
        require(self.pixel.dtype == np.uint32, "pixel dtype", str(self.pixel.dtype), "uint32")
        require(self.pixel.shape == self.toa.shape and self.pixel.ndim == 1, "pixel and toa shapes",
                f"{self.pixel.shape} and {self.toa.shape}", "the same [N]")

    @property
    def photons(self) -> int:
        """Number of photons."""
        return len(self.toa)

    @cached_property
    def is_sorted(self) -> bool:
        """True if `pixel` never decreases: sketching is then several times faster."""
        return bool((self.pixel[1:] >= self.pixel[:-1]).all())

    def part(self, which: np.ndarray) -> "PhotonEvents":
        """The photons that an index, slice or mask [N] selects."""
        return replace(self, pixel=self.pixel[which], toa=self.toa[which])

    def check(self, sensor: SensorModel) -> None:
        """Raise InvalidInput if a photon lies outside the sensor's pixels or bins."""
        if self.photons == 0:
            return
        worst = int(self.pixel[-1] if self.is_sorted else self.pixel.max())
        require(worst < sensor.pixels, "pixel", worst,
                f"an index below {sensor.rows} × {sensor.cols} = {sensor.pixels}")
        low = self.toa.min() if self.toa.dtype.kind == "f" else self.toa.dtype.type(0)
        high = self.toa.max()                           # a NaN makes low and high NaN
        require(bool(low >= 0 and high < sensor.num_bins), "toa", (low if high < sensor.num_bins else high).item(),
                f"bins in [0, {sensor.num_bins})")


@dataclass(frozen=True, eq=False)
class PhotonGates:
    """G laser cycles of a SPAD array: one ToA word per pixel and cycle.

    Args:
        words: uint16 [G, rows, cols]; bin = word − sensor.gates.first_word, sensor.gates.no_detection = no photon.
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock.
        photons: number of photons, if counted.
    """

    words: np.ndarray
    stamp_ns: int = 0
    photons: int = 0

    def __post_init__(self):
        require(self.words.dtype == np.uint16, "gates dtype", str(self.words.dtype), "uint16")
        require(self.words.ndim == 3, "gates shape", self.words.shape, "[cycles, rows, cols]")

    def check(self, sensor: SensorModel) -> None:
        """Raise InvalidInput unless the gates have the sensor's pixels, and words that are bins or `no_detection`."""
        require(self.words.shape[1:] == sensor.shape, "gates shape", self.words.shape,
                f"[cycles, rows, cols] with {sensor.shape}")
        form = sensor.gate_words
        last = min(form.first_word + sensor.num_bins, 65_536) - 1
        outside = (self.words < form.first_word) | (self.words > last)
        stray = self.words[outside & (self.words != form.no_detection)]
        require(len(stray) == 0, "gates word", int(stray.max(initial=0)),
                f"{form.first_word} to {last}, or {form.no_detection} for no detection")

    def counted(self, sensor: SensorModel) -> SensorModel:
        """The sensor with `cycles` = G, which events of the same photons no longer tell."""
        return sensor.replace(cycles=len(self.words) or None)

    def to_events(self, sensor: SensorModel) -> PhotonEvents:
        """The same photons as events sorted by pixel; InvalidInput for gates that are not the sensor's."""
        self.check(sensor)
        form = sensor.gate_words
        words = self.words.reshape(len(self.words), sensor.pixels).T
        pixel, cycle = np.nonzero(words != form.no_detection)
        return PhotonEvents(pixel.astype(np.uint32), words[pixel, cycle] - np.uint16(form.first_word), self.stamp_ns)


@dataclass(frozen=True, eq=False)
class PhotonHistograms:
    """Photons counted by bin, as histogramming sensors send them.

    Args:
        counts: uint8, uint16, int32 or float32 [rows, cols, n], photons in each bin; negative ones, of int32 and
            float32, where the sensor has subtracted ambient light. n is T, or what `sensor.histograms` says.
        stamp_ns: start of acquisition, nanoseconds of the sensor's clock.
    """

    counts: np.ndarray
    stamp_ns: int = 0

    def __post_init__(self):
        require(self.counts.dtype in COUNT_DTYPES, "histograms dtype", str(self.counts.dtype),
                "uint8, uint16, int32 or float32")
        require(self.counts.ndim == 3, "histograms shape", self.counts.shape, "[rows, cols, bins]")

    @cached_property
    def photons(self) -> int:
        """Number of photons; 0 if negative counts outweigh them."""
        flat = self.counts.reshape(-1)
        if self.counts.dtype.kind != "u":
            return max(round(float(flat.sum(dtype=np.float64))), 0)
        # Sum parts in 32 bits: exact, and twice as fast as in 64 bits.
        return sum(int(flat[first:first + CHUNK].sum(dtype=np.uint32)) for first in range(0, len(flat), CHUNK))

    @cached_property
    def lowest(self) -> float:
        """The lowest count, or 0 for types that have no negative ones; NaN if any count is."""
        return 0 if self.counts.dtype.kind == "u" else self.counts.min().item()

    @property
    def has_negative(self) -> bool:
        """Whether any count is negative: something was subtracted, and the counts are not those of detections."""
        return self.lowest < 0

    def check(self, sensor: SensorModel) -> None:
        """Raise InvalidInput unless the histograms have the sensor's pixels and bins, and finite counts in range."""
        wanted = *sensor.shape, sensor.histogram_size
        require(self.counts.shape == wanted, "histograms shape", self.counts.shape, f"[rows, cols, bins] = {wanted}")
        if self.counts.dtype.kind != "u":
            low, high, most = self.lowest, self.counts.max().item(), MAX_OF_PIXEL // wanted[2]
            if not (-most <= low and high <= most):     # a NaN makes low and high NaN
                whole = max(np.abs(row, dtype=np.float64).sum(axis=1).max() for row in self.counts)
                require(whole <= MAX_OF_PIXEL, "histograms count", high if high > most else low,
                        f"finite numbers, at most {MAX_OF_PIXEL} photons in a pixel")

    def on_axis(self, sensor: SensorModel) -> np.ndarray:
        """The counts in the sensor's T bins, each in the bin that holds its middle; [rows, cols, T]."""
        bins = sensor.histograms
        if bins is None:
            return self.counts
        counts = self._of_the_scene(sensor)
        out = np.zeros((sensor.pixels, sensor.num_bins), np.float32)
        np.add.at(out.T, np.minimum(bins.centers().astype(np.int64), sensor.num_bins - 1), counts.T)
        return out.reshape(*sensor.shape, -1)

    def _of_the_scene(self, sensor: SensorModel) -> np.ndarray:
        """The counts minus the sensor's template, [rows · cols, n]."""
        counts, bins = self.counts.reshape(sensor.pixels, -1), sensor.histograms
        return counts if bins is None or bins.template is None else counts - bins.template

    def to_events(self, sensor: SensorModel) -> PhotonEvents:
        """The same photons as events sorted by pixel; InvalidInput unless they fit the sensor and are whole numbers."""
        self.check(sensor)
        bins, counts = sensor.histograms, self._of_the_scene(sensor).reshape(-1)
        at = np.flatnonzero(counts)
        numbers = counts[at].astype(np.int64)
        require(bool((numbers == counts[at]).all() and (numbers > 0).all()), "histograms",
                "negative or fractional in places", "whole photons, to tell them one by one")
        pixel, toa = np.divmod(at, self.counts.shape[2])
        if bins is not None:
            toa = bins.centers()[toa] - 0.5         # middles, counted in bins
            if (toa != np.floor(toa)).any():
                toa = sensor.wrapped(toa)
        toa = toa if toa.dtype == np.float32 else toa.astype(np.uint16)
        return PhotonEvents(pixel.astype(np.uint32).repeat(numbers), toa.repeat(numbers), self.stamp_ns)


PhotonFrame = PhotonEvents | PhotonGates | PhotonHistograms
