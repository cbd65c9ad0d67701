"""How clouds look in pictures: coloured by range, shaded by intensity, on a dark background. NumPy only."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.colours import colour_table, levels, percentile_range
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.pictures.raster import draw_surface
from srt3d_ros.viewpoint import Viewpoint, point_radius_m

BACKGROUND = (13, 16, 21)
# Near is bright, so that what is in front stands out; without the darkest quarter, which the background would swallow.
RANGE_MAP = colour_table("viridis")[np.linspace(255, 45, 256).round().astype(int)]
_OUTSIDE = (96, 104, 116)
_RADIUS_PER_DISTANCE = 0.6      # neighbours then just overlap
_CLOSER = 1.2                   # larger points than in the viewer: no gaps in surfaces seen aslant


@dataclass(frozen=True, eq=False)
class Look:
    """What the panels of a picture share: the ends of the range's colours in metres, and the size of the points."""

    near_m: float
    far_m: float
    radius_m: float

    @classmethod
    def of(cls, cloud: PointCloud, sensor: SensorModel | None) -> "Look":
        """The look that suits a cloud; without a sensor its points get the size that closes an even surface up."""
        range_m = np.linalg.norm(cloud.xyz, axis=1)
        near_m, far_m = percentile_range(range_m, 1, 99) or (
            sensor.range_m(np.array([0, sensor.num_bins])) if sensor else (0.0, 1.0))
        radius_m = point_radius_m(cloud.xyz, sensor) if sensor else _even_radius_m(cloud.xyz)
        return cls(float(near_m), float(far_m), _CLOSER * radius_m)

    def colour(self, xyz: np.ndarray) -> np.ndarray:
        """Colours of points by their range, uint8 [N, 3]; those far outside the cloud's ranges are grey."""
        range_m, span_m = np.linalg.norm(xyz, axis=1), self.far_m - self.near_m
        colour = RANGE_MAP[levels(range_m, self.near_m, self.far_m)]
        colour[(range_m < self.near_m - 0.2 * span_m) | (range_m > self.far_m + 0.2 * span_m)] = _OUTSIDE
        return colour

    def shaded(self, cloud: PointCloud) -> np.ndarray:
        """Colours of a cloud's points by range, darker where the intensity is low, uint8 [N, 3]."""
        low, high = percentile_range(cloud.intensity) or (0, 1)
        bright = levels(cloud.intensity, low, high, root=True)[:, None] / np.float32(255)
        return (self.colour(cloud.xyz) * (0.7 + 0.3 * bright)).astype(np.uint8)

    def draw(self, cloud: PointCloud, eye: Viewpoint, width: int, height: int, finer: int = 2) -> np.ndarray:
        """A cloud as `eye` sees it, uint8 [height, width, 3]; `finer` as for `draw_surface`."""
        return draw_surface(cloud.xyz, self.shaded(cloud), eye, width, height, self.radius_m, BACKGROUND, finer)


def _even_radius_m(xyz: np.ndarray) -> float:
    """Half the distance of points spread evenly over the two larger sides of the box that holds most of them."""
    sides = [np.subtract(*(percentile_range(axis, 1, 99) or (0, 0))[::-1]) for axis in xyz.T]
    return float(np.sqrt(np.prod(sorted(sides)[1:]) / max(len(xyz), 1))) * _RADIUS_PER_DISTANCE
