"""Where the last cloud's surfaces are by now: the ranges by which a moving sensor's photons know their parallax."""

import numpy as np

from srt3d_ros.core.deskew import range_image
from srt3d_ros.core.motion import Pose
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require


def moved_ranges(depth: np.ndarray, sensor: SensorModel, motion: Pose) -> np.ndarray:
    """The range along each pixel's ray after a motion; float32 [rows, cols], metres, NaN where it is not known.

    Args:
        depth: float32 [k · rows, k · cols], as a depth image shows it before the motion (REP-118: z of a pinhole, range
            of a scanner; NaN or 0 = none), of an upsampling k.
        motion: of a point in the sensor's frame, from then to now.

    Raises:
        InvalidInput: a depth image of another size.
    """
    finer = max(depth.shape[0] // sensor.rows, 1)
    require(depth.shape == (finer * sensor.rows, finer * sensor.cols), "depth image", f"{depth.shape} pixels",
            f"{sensor.rows} × {sensor.cols} pixels, or a multiple of both")
    projection = sensor.projection.upsampled(finer)
    seen = np.isfinite(depth) & (depth > 0)
    rays, along = (sensor.rays if finer == 1 else projection.rays(*depth.shape))[seen], depth[seen]
    if isinstance(projection, Pinhole):
        along = along / rays[:, 2]
    return range_image(sensor, motion(rays * along[:, None]))
