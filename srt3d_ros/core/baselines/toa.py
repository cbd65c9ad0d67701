"""Times of arrival by pixel, for the methods that need every photon."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.photons import PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel


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
    """The photons of a frame sorted by pixel.

    Raises:
        InvalidInput: if a photon lies outside the sensor's pixels or bins, or the sensor does not say what words mean.
    """
    if isinstance(frame, PhotonGates):
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


def exposure(sensor: SensorModel) -> np.ndarray:
    """How many photons a pixel sees against one of gain 1; 0 where masked. float32 [rows, cols]."""
    gain = np.ones((sensor.rows, sensor.cols), np.float32) if sensor.gain is None else sensor.gain
    return gain if sensor.mask is None else gain * sensor.mask
