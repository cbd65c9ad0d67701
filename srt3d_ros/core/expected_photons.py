"""The photons that a cloud makes expected at a time of arrival, to hold it against those that were seen."""

import numpy as np

from srt3d_ros.core.point_cloud import IMAGES, PointCloud
from srt3d_ros.core.sensor.model import SensorModel


def expected_at(cloud: PointCloud, sensor: SensorModel, pixel: np.ndarray, toa: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
    """Σ_k r_k h(x − t_k − δ), signal photons a bin at gain 1, and T b(x − δ), the background over its mean.

    h is the pixel's IRF, linear between its bins, modulo T; δ its delay; b the sensor's background shape.

    Args:
        cloud: points with depths t_k and intensities r_k.
        pixel, toa: [N], pixels and times of arrival x in bins.

    Returns:
        float64 [N] each.
    """
    irf, signal = np.atleast_2d(sensor.irf), np.zeros(len(pixel))
    position = toa - sensor.late.reshape(-1)[pixel].astype(np.float64)
    for k in np.unique(cloud.surface).tolist():
        depth, intensity = (np.nan_to_num(cloud.image(name, k).reshape(-1)[pixel]) for name in IMAGES[:2])
        low, between = np.divmod(position - depth - sensor.irf_bins[0], 1)
        for entry, share in ((low, 1 - between), (low + 1, between)):
            entry = entry.astype(np.int64) % sensor.num_bins
            inside = entry < irf.shape[1]
            density = irf[pixel if len(irf) > 1 else 0, np.where(inside, entry, 0)]
            signal += np.maximum(intensity, 0) * share * inside * density
    if sensor.background_shape is None:
        return signal, np.ones(len(pixel))
    shape = sensor.num_bins * sensor.background_shape
    return signal, np.interp(position, np.arange(sensor.num_bins), shape, period=sensor.num_bins)
