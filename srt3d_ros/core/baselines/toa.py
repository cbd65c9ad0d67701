"""Times of arrival by pixel, for the methods that need every photon."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame


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
