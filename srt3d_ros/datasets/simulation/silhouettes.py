"""Scenes before an empty sky, to see how far the outlines of surfaces swell: a lattice of girders, a house.

Their pixels see a surface in their middle or none. The depth is that of one plane, aslant.
"""

import numpy as np

from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.simulation.scene import StaticScene

FIELD_M = 10.0          # across the image, at the distance of the scene
RANGE_M = 400.0         # to the middle of the scene
SLOPE = 0.3             # metres of range per metre to the right; a third of it upwards
# Girders, metres: x and y of both ends, width. The image is 10 m wide, its middle at 0, y points down.
GIRDERS = (*((x, -4.2, x, 4.2, 0.31) for x in (-4, 0, 4)),
           *((-4, y, 4, y, 0.23) for y in (-4, -1.3, 1.4, 4)),
           *((side * 4, y, 0, y + 2.7, 0.2) for side in (-1, 1) for y in (-4, 1.3)),
           *((0, -1.3, side * 4, 1.4, 0.16) for side in (-1, 1)),
           (0, -4.8, 0, -4, 0.12))
# Of the house: corners (left, top, right, bottom), metres.
WALL, ROOF_RIDGE, CHIMNEY = (-3.6, -0.8, 3.6, 4.0), (-3.6, 4.3), (1.6, -3.9, 2.2, -1.5)    # ridge: y, half width
WINDOWS = tuple((x, y, x + 0.9, y + 1.1) for x in (-2.9, -1.3, 0.4, 2.0) for y in (-0.2, 2.0) if (x, y) != (0.4, 2.0))
DOOR, ATTIC_WINDOW = (0.4, 2.0, 1.4, 4.0), (0.0, -1.9, 0.5)                                # attic: x, y, radius
BAR_M = 0.12            # width of the bars that divide a window


def silhouette_sensor() -> SensorModel:
    """A sensor for both: 256 × 256 pixels, 10 m across at 400 m, T = 1024 bins of 15 mm, an IRF 8 bins wide."""
    bin_width_s = 100e-12
    metres = SPEED_OF_LIGHT / 2 * bin_width_s
    return SensorModel(rows=256, cols=256, num_bins=1024, bin_width_s=bin_width_s,
                       irf=irf.spad(bin_width_s, fwhm_s=750e-12),
                       toa_offset_bins=round(RANGE_M / metres) - 512,
                       projection=Pinhole.from_fov(256, 256, fov_deg=float(np.degrees(2 * np.arctan(
                           FIELD_M / 2 / RANGE_M)))))


def lattice(sensor: SensorModel) -> StaticScene:
    """Girders of 3 to 8 pixels before the sky."""
    x, y = _places(sensor)
    return _before_the_sky(x, y, np.any([_on_girder(x, y, *girder) for girder in GIRDERS], axis=0))


def house(sensor: SensorModel) -> StaticScene:
    """A house through whose windows and door the sky is seen."""
    x, y = _places(sensor)
    ridge, half_width = ROOF_RIDGE
    roof = (y < WALL[1]) & (np.abs(x) < half_width * (y - ridge) / (WALL[1] - ridge))
    solid = _inside(x, y, WALL) | roof | _inside(x, y, CHIMNEY)
    for left, top, right, bottom in WINDOWS:
        bars = (np.abs(x - (left + right) / 2) < BAR_M / 2) | (np.abs(y - (top + bottom) / 2) < BAR_M / 2)
        solid &= ~_inside(x, y, (left, top, right, bottom)) | bars
    attic_x, attic_y, radius = ATTIC_WINDOW
    solid &= ~_inside(x, y, DOOR) & (np.hypot(x - attic_x, y - attic_y) > radius)
    return _before_the_sky(x, y, solid)


def _places(sensor: SensorModel) -> tuple[np.ndarray, np.ndarray]:
    """x and y of each pixel at the distance of the scene, metres."""
    rays = sensor.rays.astype(np.float64)
    return rays[..., 0] / rays[..., 2] * RANGE_M, rays[..., 1] / rays[..., 2] * RANGE_M


def _before_the_sky(x: np.ndarray, y: np.ndarray, solid: np.ndarray) -> StaticScene:
    range_m = np.where(solid, RANGE_M + SLOPE * (x - y / 3), np.nan)
    return StaticScene(range_m, np.where(solid, 1.0, 0.0))


def _on_girder(x: np.ndarray, y: np.ndarray, x1: float, y1: float, x2: float, y2: float, width: float) -> np.ndarray:
    along_x, along_y = x2 - x1, y2 - y1
    share = np.clip(((x - x1) * along_x + (y - y1) * along_y) / (along_x**2 + along_y**2), 0, 1)
    return np.hypot(x - x1 - share * along_x, y - y1 - share * along_y) < width / 2


def _inside(x: np.ndarray, y: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
    left, top, right, bottom = box
    return (x > left) & (x < right) & (y > top) & (y < bottom)
