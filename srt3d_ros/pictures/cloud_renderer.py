"""Render clouds in perspective with NumPy and Pillow, coloured by range and shaded by intensity.

Points are drawn as discs from far to near. Then edges are darkened by the depth around each pixel (eye-dome lighting:
Boucheny, Interactive Scientific Visualization of Large Datasets: Towards a Perceptive-Based Approach, thesis, Grenoble
2009), which shows shape without normals.
"""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import quoted, require
from srt3d_ros.pictures.colours import BACKGROUND, levels, percentile_range, shaded
from srt3d_ros.pictures.quantities import QUANTITIES, RANGE, Points, Quantity
from srt3d_ros.pictures.viewpoint import Viewpoint, point_radius_m

_OUTSIDE, _FAR_OUTSIDE = (96, 104, 116), 0.7     # grey; distance from the middle of the ends, of their distance
_RADIUS_FACTOR = 1.2            # times the viewer's radius, to leave no gaps in oblique surfaces
_NEAREST = 1e-3                 # of the distance to the target; closer points are not drawn
_SMALLEST_RADIUS_PX, _LARGEST_RADIUS_PX = 0.75, 24.0
_EDGE_REACHES = (0.004, 0.015)  # distances of edge shading, as a fraction of the picture's height
_EDGE_SLOPE = 0.7               # ratio of depth step to reach that gives 63 % of the greatest darkening
_DEEPEST_EDGE = 0.02            # of the distance between eye and target; deeper edges are not darker
_DARKEST_EDGE = 0.5
_FOG_OPACITY = 0.6              # of one point


@dataclass(frozen=True, eq=False)
class CloudStyle:
    """Style shared by the panels of a picture: the values at the two ends of the colours, and the points' radius."""

    ends: tuple[float, float]
    radius_m: float
    quantity: Quantity = RANGE

    @classmethod
    def of(cls, cloud: Points, sensor: SensorModel, colour_by: str = "range") -> "CloudStyle":
        """The style that suits a cloud; InvalidInput if its points have no such quantity."""
        require(colour_by in QUANTITIES, "colour_by", quoted(colour_by), ", ".join(QUANTITIES))
        quantity = QUANTITIES[colour_by]
        values = quantity.values(cloud)
        ends = percentile_range(values)
        require(ends or not len(values), "colour_by",
                problem=f"The points have no {colour_by}: their method gives none.")
        if ends is None:
            ends = tuple(sensor.range_m(np.array([0, sensor.num_bins]))) if quantity is RANGE else (0.0, 1.0)
        return cls(ends, _RADIUS_FACTOR * point_radius_m(cloud.xyz, sensor), quantity)

    def colour(self, values: np.ndarray) -> np.ndarray:
        """Colours of points by their values of the quantity, uint8 [N, 3]; grey for ranges far outside low to high."""
        colour, (low, high) = self.quantity.table[self.quantity.levels(values, self.ends)], self.ends
        if self.quantity is RANGE:
            colour[np.abs(values - (low + high) / 2) > _FAR_OUTSIDE * (high - low)] = _OUTSIDE
        return colour

    def draw(self, cloud: Points, eye: Viewpoint, width: int, height: int, finer: int = 2) -> np.ndarray:
        """A cloud seen from `eye`, uint8 [height, width, 3]; `finer` as for draw_surface."""
        colour = self.colour(self.quantity.values(cloud))
        if self.quantity is RANGE:
            colour = shaded(colour, levels(cloud.intensity, root=True))
        return draw_surface(cloud.xyz, colour, eye, width, height, self.radius_m, finer)


def draw_surface(xyz: np.ndarray, colour: np.ndarray, eye: Viewpoint, width: int, height: int, radius_m: float,
                 finer: int) -> np.ndarray:
    """Draw points as opaque discs; uint8 [height, width, 3].

    Args:
        xyz: float [N, 3], metres; NaN and Inf are skipped.
        colour: uint8 [N, 3].
        radius_m: radius of the discs, which cover at least one pixel.
        finer: supersampling; 2 gives smooth edges for four times the work.
    """
    width, height = width * finer, height * finer
    x, y, depth = project(xyz, eye, width, height)
    seen = np.flatnonzero(np.isfinite(x + y + depth) & (np.abs(x) < 2 * width) & (np.abs(y) < 2 * height))
    seen = seen[np.argsort(-depth[seen])]
    x, y, depth = x[seen], y[seen], depth[seen]
    radius_px = radius_m * focal_px(eye, width, height) / depth
    radius_px = np.clip(radius_px, _SMALLEST_RADIUS_PX, _LARGEST_RADIUS_PX * finer)
    discs = Image.new("I", (width, height), -1)
    draw = ImageDraw.Draw(discs)
    first, last = (np.stack([x, y], axis=1) + side * radius_px[:, None] for side in (-1, 1))
    for k, box in enumerate(np.hstack([first, last - 1]).tolist()):         # Pillow takes the first and last pixel
        draw.ellipse(box, fill=k)
    top = np.asarray(discs).ravel()         # number of the nearest disc
    covered = top >= 0
    image = np.empty((width * height, 3), np.float32)
    image[:] = BACKGROUND
    buffer = np.full(width * height, np.inf, np.float32)
    buffer[covered] = depth[top[covered]]
    with np.errstate(invalid="ignore"):     # inf − inf in the background
        shade = _edge_shade(buffer.reshape(height, width), np.linalg.norm(eye.target - eye.position)).ravel()
    image[covered] = colour[seen][top[covered]] * shade[covered, None]
    return image.reshape(height // finer, finer, width // finer, finer, 3).mean(axis=(1, 3)).astype(np.uint8)


def draw_fog(xyz: np.ndarray, colour: np.ndarray, eye: Viewpoint, width: int, height: int, size_px: int
             ) -> np.ndarray:
    """Draw points as squares of `size_px`, more opaque where there are many; uint8 [height, width, 3]."""
    x, y, _ = project(xyz, eye, width, height)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)      # False for NaN
    rows, cols = -(-height // size_px), -(-width // size_px)
    square = (y[inside] // size_px).astype(np.int64) * cols + (x[inside] // size_px).astype(np.int64)
    number = np.bincount(square, minlength=rows * cols)[:, None]
    total = np.stack([np.bincount(square, colour[inside, c], minlength=rows * cols) for c in range(3)], axis=1)
    cover = 1 - (1 - _FOG_OPACITY)**number
    image = (total / np.maximum(number, 1) * cover + (1 - cover) * BACKGROUND).astype(np.uint8).reshape(rows, cols, 3)
    return image.repeat(size_px, axis=0).repeat(size_px, axis=1)[:height, :width]


def project(xyz: np.ndarray, eye: Viewpoint, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Project points [N, 3] to x and y in pixels and the depth in metres; NaN = behind the eye."""
    with np.errstate(invalid="ignore", divide="ignore"):
        right, down, forward = ((np.asarray(xyz, np.float32) - eye.position.astype(np.float32))
                                @ eye.axes().T.astype(np.float32)).T
        nearest = _NEAREST * np.linalg.norm(eye.target - eye.position)
        forward = np.where(forward > nearest, forward, np.nan)
        focal = focal_px(eye, width, height)
        return right / forward * focal + width / 2, down / forward * focal + height / 2, forward


def focal_px(eye: Viewpoint, width: int, height: int) -> float:
    """Focal length in pixels: fov_deg spans the smaller side of the picture."""
    return min(width, height) / 2 / np.tan(np.radians(eye.fov_deg) / 2)


def _edge_shade(depth: np.ndarray, distance: float | np.floating) -> np.ndarray:
    """Brightness float32: 1 on smooth surfaces, less beside something nearer. In `depth`, inf = background."""
    light = np.ones_like(depth)
    rows, cols = depth.shape
    for reach in _EDGE_REACHES:
        step = max(round(reach * rows), 1)
        padded = np.pad(depth, step, constant_values=np.inf)
        around = (padded[i * step:i * step + rows, j * step:j * step + cols] for i, j in np.ndindex(3, 3)
                  if (i, j) != (1, 1))
        occlusion = sum(np.clip(depth - beside, 0, _DEEPEST_EDGE * distance) for beside in around) / 8
        light *= 1 - _DARKEST_EDGE * (1 - np.exp(-occlusion / (reach * _EDGE_SLOPE * distance)))
    return light
