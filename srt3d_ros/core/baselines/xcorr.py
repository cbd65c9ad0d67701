"""XCORR: the classical matched filter on every pixel's histogram, which also starts RT3D.

t̂ = arg max_t Σ_b y_b log(h(b − t) + ε): maximum likelihood for one surface over a faint background, by FFT over the T
bins, with a parabola through the peak. Further surfaces follow one by one, after the photons under the IRF of the
former ones are removed. The signal is what a window around the peak holds above the background outside. As in the
papers, every pixel with photons shows a point.
"""

from dataclasses import replace
from importlib import import_module

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame
from srt3d_ros.progress import progress

CELLS = 2**22           # bins of the histograms that are filtered together: 16 MB an array
FLOOR = 0.01            # ε, relative to the IRF's peak: finds more surfaces than ε = 0 at any SBR from 0.1 to 50
TIE = 1e-4              # peaks that differ by less are equal: the FFT rounds
BODY_SHARE = 0.9        # of the IRF, in the window in which signal photons are counted
WHOLE_SHARE = 0.99      # of the IRF, in the window that is removed for the next surface


class XCORR:
    """Reconstructs frames of one sensor from their photons; arguments as for `Pooled`."""

    def __init__(self, sensor: SensorModel, surfaces: int = 1):
        self.sensor, self.surfaces = sensor, surfaces
        irf = np.atleast_2d(sensor.irf)
        self._overlap = irf.shape[1] - 1                # bins after the last one, for the IRF of late returns
        self._fft = import_module("scipy.fft")          # here: importing it is slow, and few need it
        self._size = self._fft.next_fast_len(sensor.num_bins + self._overlap, real=True)
        self._weights = np.log1p(irf / (FLOOR * irf.max(axis=1, keepdims=True)))    # 0 outside the IRF
        self._body, self._whole = (_window(sensor.mean_irf, share) for share in (BODY_SHARE, WHOLE_SHARE))

    def __call__(self, frame: PhotonFrame) -> PointCloud:
        """The point cloud of one frame."""
        depth, intensity, background = self.peaks(by_pixel(frame, self.sensor))
        background = background * self.sensor.exposure * self.sensor.num_bins
        return PointCloud.from_layers(self.sensor, depth, intensity, background, frame.stamp_ns)

    def peaks(self, photons: PhotonEvents) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The K highest peaks of every pixel's histogram, correlated with the IRF; `photons` from `by_pixel`.

        Returns:
            Depths, bins in [0, T) without the pixels' delays, and signal photons, 0 = no peak, float32
            [rows, K, cols]; background photons per bin, float32 [rows, cols]. Photon numbers are for a gain of 1.
        """
        sensor, seen = self.sensor, np.maximum(self.sensor.exposure, 1e-6)
        several = max(CELLS // sensor.num_bins, 1)
        parts = [self._peaks_of(photons, first, min(first + several, sensor.pixels))
                 for first in progress(range(0, sensor.pixels, several), "correlating")]
        depth, signal, background = (np.concatenate(part, axis=-1).reshape(-1, *sensor.shape) for part in zip(*parts))
        depth, signal = (np.ascontiguousarray(values.swapaxes(0, 1), np.float32)
                         for values in ((depth - sensor.late) % sensor.num_bins, signal / seen))
        return depth, signal, (background[0] / seen).astype(np.float32)

    def warm_up(self) -> None:
        """Does nothing: there is nothing to compile."""

    def _peaks_of(self, photons: PhotonEvents, first: int, last: int):
        """Depth and signal photons, [K, pixels], and background per bin [pixels], of a range of pixels."""
        num_bins = self.sensor.num_bins
        part = slice(*np.searchsorted(photons.pixel, np.array([first, last], np.uint32)))
        bins = np.rint(photons.toa[part]).astype(np.int64) % num_bins
        pixel = photons.pixel[part].astype(np.int64) - first
        found = []
        for _ in range(self.surfaces):
            begin, shift = self._highest(pixel, bins, slice(first, last))
            place = (bins - begin[pixel]) % num_bins                                # of each photon within the IRF
            body, whole = ((place >= low) & (place < high) for low, high in (self._body, self._whole))
            found.append((begin + self.sensor.irf_ref + shift, np.bincount(pixel[body], minlength=last - first)))
            pixel, bins = pixel[~whole], bins[~whole]
        outside = max(num_bins - self.surfaces * (self._whole[1] - self._whole[0]), 1)
        background = np.bincount(pixel, minlength=last - first) / outside
        depth, near = map(np.stack, zip(*found))
        width = self._body[1] - self._body[0]
        return depth, np.maximum(near - background * width, 0) / BODY_SHARE, background

    def _highest(self, pixel: np.ndarray, bins: np.ndarray, pixels: slice):
        """The bin at which the IRF begins for the highest peak of each pixel, and the peak's offset, −½ … ½ bin."""
        count, num_bins = pixels.stop - pixels.start, self.sensor.num_bins
        places, photons = np.unique(pixel * self._size + bins, return_counts=True)
        histogram = np.zeros((count, self._size), np.float32)
        histogram.reshape(-1)[places] = photons
        histogram[:, num_bins:num_bins + self._overlap] = histogram[:, :self._overlap]
        weights = self._weights if len(self._weights) == 1 else self._weights[pixels]
        spectrum = self._fft.rfft(histogram, workers=-1)
        spectrum *= self._fft.rfft(weights, n=self._size, workers=-1).conj()
        response = self._fft.irfft(spectrum, n=self._size, overwrite_x=True, workers=-1)[:, :num_bins]
        # Single photons give equal peaks: every second pixel takes the last one, so that no depth is favoured.
        high = response >= (1 - TIE) * response.max(axis=1, keepdims=True)
        first, last = high.argmax(axis=1), num_bins - 1 - high[:, ::-1].argmax(axis=1)
        begin = np.where(np.arange(count) % 2 == 0, first, last)
        before, peak, after = (response[np.arange(count), (begin + step) % num_bins] for step in (-1, 0, 1))
        bend = before - 2 * peak + after
        shift = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=bend < 0)
        return begin, shift.clip(-0.5, 0.5)


def by_pixel(frame: PhotonFrame, sensor: SensorModel) -> PhotonEvents:
    """The photons of a frame sorted by pixel, without masked pixels; InvalidInput unless they fit the sensor.

    ToA become float32 positions on the axis of bins, with the pixels' delays.
    """
    events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
    events.check(sensor)
    if not events.is_sorted:
        events = events.part(np.argsort(events.pixel, kind="stable"))
    if sensor.mask is not None:     # saves a copy
        events = events.part(sensor.mask.ravel()[events.pixel])
    return replace(events, toa=events.toa.astype(np.float32, copy=False))


def _window(irf: np.ndarray, share: float) -> tuple[int, int]:
    """The shortest window with this share of the IRF: first entry, and one past the last."""
    total = np.concatenate([[0], np.cumsum(irf, dtype=np.float64)])
    last = np.searchsorted(total, total + share * total[-1] * (1 - 1e-9))
    length = np.where(last < len(total), last - np.arange(len(total)), len(total))
    first = int(length.argmin())
    return first, first + int(length[first])
