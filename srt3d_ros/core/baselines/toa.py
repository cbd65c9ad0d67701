"""Times of arrival by pixel, for the methods that need every photon, and how exactly they tell the depth."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame

RATIOS = np.geomspace(1e-7, 1e3, 101)       # background photons per bin and signal photon


@dataclass(frozen=True, eq=False)
class PixelToa:
    """The photons of every pixel, one pixel after the other; masked pixels have none.

    Args:
        starts: int64 [rows · cols + 1]; the photons of pixel p are starts[p] … starts[p + 1] − 1.
        toa: float32 [N], positions on the axis of depths, as measured: the pixels' delays are still in them.
        stamp_ns: of the frame.
    """

    starts: np.ndarray
    toa: np.ndarray
    stamp_ns: int

    @property
    def counts(self) -> np.ndarray:
        """Photons of each pixel, int64 [rows · cols]."""
        return np.diff(self.starts)


def by_pixel(frame: PhotonFrame, sensor: SensorModel) -> PixelToa:
    """The photons of a frame sorted by pixel; InvalidInput unless they fit the sensor."""
    if not isinstance(frame, PhotonEvents):
        frame = frame.to_events(sensor)
    frame.check(sensor)
    pixel, toa = frame.pixel, frame.toa
    if not frame.is_sorted:
        order = np.argsort(pixel, kind="stable")
        pixel, toa = pixel[order], toa[order]
    if sensor.mask is not None:
        used = sensor.mask.ravel()[pixel]
        pixel, toa = pixel[used], toa[used]
    starts = np.searchsorted(pixel, np.arange(sensor.pixels + 1, dtype=np.uint32))
    return PixelToa(starts, sensor.toa_positions(toa), frame.stamp_ns)


def irf_slope(irf: np.ndarray) -> np.ndarray:
    """h′ between neighbouring bins' means, per bin; as long as the IRF, [..., L]."""
    padded = np.pad(irf.astype(np.float64), [(0, 0)] * (irf.ndim - 1) + [(1, 1)])
    return (padded[..., 2:] - padded[..., :-2]) / 2


class DepthInformation:
    """Fisher information of a Poisson process r h(x − t) + b on t: r Σ_x h′(x)² / (h(x) + b / r), bins⁻².

    Args:
        sensor: gives h; of sensors with an IRF per pixel the mean IRF.
    """

    def __init__(self, sensor: SensorModel):
        irf = np.atleast_2d(sensor.irf).mean(axis=0).astype(np.float64)
        slope = irf_slope(irf)
        self._per_photon = np.array([max((slope**2 / (irf + ratio)).sum(), 1e-12) for ratio in RATIOS])

    def std(self, signal: np.ndarray, background: np.ndarray) -> np.ndarray:
        """Standard deviation of efficient depths, bins, from r and b, photons and photons per bin that were seen."""
        signal = np.maximum(signal, 1e-6)
        return 1 / np.sqrt(signal * self.per_photon(background / signal))

    def per_photon(self, ratio: np.ndarray) -> np.ndarray:
        """What each signal photon adds, bins⁻², amid a background of b / r per bin."""
        return np.interp(np.log(np.maximum(ratio, RATIOS[0])), np.log(RATIOS), self._per_photon)
