"""Clouds on a grid of finer pixels than the sensor has, as the SRT3D paper draws those of arrays of 32 × 32."""

from dataclasses import replace

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel


def refine(cloud: PointCloud, factor: int, sensor: SensorModel, slope_row: np.ndarray,
           slope_col: np.ndarray) -> PointCloud:
    """The cloud on `factor` × `factor` finer pixels in the place of each: t(x, y) = t + x · slope_col + y · slope_row.

    Each point becomes one in every finer pixel, on its tangent plane, x and y pixels from the centre. Intensity and
    background are photons of a finer pixel, an equal share of the pixel's; the standard deviation stays, for the depths
    of a pixel's points are wrong together. Faster than to reconstruct split sketches on the finer grid, and better
    where photons are few: windows of the same number of pixels would pool factor² times fewer photons.

    Args:
        cloud: on the pixels of the sketch.
        factor: finer pixels along the side of a pixel.
        sensor: the finer one, which places the points.
        slope_row, slope_col: float32 [N], bins per pixel downwards and to the right.
    """
    y, x = np.divmod(np.arange(factor**2), factor)
    row, col = ((of_pixel[:, None].astype(np.int64) * factor + finer).reshape(-1)
                for of_pixel, finer in ((cloud.row, y), (cloud.col, x)))
    surface = cloud.surface.repeat(factor**2)
    order = np.lexsort((surface, col, row))
    down, right = (((finer + 0.5) / factor - 0.5).astype(np.float32) for finer in (y, x))
    rise = slope_row[:, None] * down + slope_col[:, None] * right
    depth = np.mod(cloud.depth_bins[:, None] + rise, np.float32(sensor.num_bins)).reshape(-1)[order]
    depth[depth >= sensor.num_bins] = 0                     # where rounding made it T
    row, col, share = row[order], col[order], np.float32(1 / factor**2)
    return replace(cloud, row=row.astype(np.uint16), col=col.astype(np.uint16), depth_bins=depth,
                   intensity=(cloud.intensity * share).repeat(factor**2)[order],
                   depth_std_bins=cloud.depth_std_bins.repeat(factor**2)[order], xyz=sensor.xyz(row, col, depth),
                   surface=surface[order],
                   background=(cloud.background * share).repeat(factor, axis=0).repeat(factor, axis=1))
