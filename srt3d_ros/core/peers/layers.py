"""What all peers share around their own mathematics: options, and clouds from maps of depth and intensity."""

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.srt3d import MAX_SURFACES, kernels_for
from srt3d_ros.errors import require


def kernels_of(name: str, surfaces: int, device: str, false_alarm_rate: float | None = None):
    """The kernels for method `name`, or InvalidInput for an option that it cannot use."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")
    require(device in ("auto", "cpu"), "device", device, f"cpu or auto: {name} has no CUDA kernels")
    require(false_alarm_rate is None or 0 < false_alarm_rate < 1, "false_alarm_rate", false_alarm_rate,
            "a probability between 0 and 1")
    return kernels_for("cpu")[1]


def to_cloud(sensor: SensorModel, depth: np.ndarray, intensity: np.ndarray, std: np.ndarray, background: np.ndarray,
             stamp_ns: int) -> PointCloud:
    """The point cloud of K layers of surfaces.

    Args:
        sensor: places the points.
        depth: float32 [rows, K, cols], bins.
        intensity: float32 [rows, K, cols]; 0 = no point.
        std: float32 [rows, K, cols], of the depths, bins.
        background: float32 [rows, cols], expected background photons.
        stamp_ns: start of acquisition.
    """
    order = np.argsort(-intensity, axis=1, kind="stable")
    depth, intensity, std = (np.take_along_axis(a, order, axis=1).swapaxes(1, 2) for a in (depth, intensity, std))
    row, col, rank = np.nonzero(intensity > 0)
    found = row, col, rank
    depth = depth[found] % np.float32(sensor.num_bins)
    depth[depth >= sensor.num_bins] = 0                     # where rounding made it T
    std = np.clip(std[found], 1e-6, sensor.num_bins)
    return PointCloud(row.astype(np.uint16), col.astype(np.uint16), depth.astype(np.float32),
                      intensity[found].astype(np.float32), std.astype(np.float32), sensor.xyz(row, col, depth),
                      rank.astype(np.uint8), background.astype(np.float32), stamp_ns)
