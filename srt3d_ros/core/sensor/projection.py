"""Projections: the unit ray of each pixel in the sensor's frame."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from srt3d_ros.core.keys import Key, documented, numbers
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.errors import require

DEFAULT_FOV_DEG = 30.0
FOCAL_LENGTHS = 1e-6, 1e100     # pixels; with CENTRES they keep squares of a ray's coordinates finite
CENTRES = -1e9, 1e9             # pixels
ANGLES_RAD = -1e6, 1e6


@documented
@dataclass(frozen=True)
class Pinhole:
    """A camera, in its optical frame: z forward, x right, y down.

    Ray ∝ ((col − cx) / fx, (row − cy) / fy, 1), but for the distortion.
    """

    fx: Annotated[float, Key("focal length", "pixel", FOCAL_LENGTHS)]
    fy: Annotated[float, Key("focal length", "pixel", FOCAL_LENGTHS)]
    cx: Annotated[float, Key("principal point", "pixel", CENTRES, "the centre of pixel (0, 0) is at (0, 0)")]
    cy: Annotated[float, Key("principal point", "pixel", CENTRES)]
    distortion: Annotated[PlumbBob, Key("of the lens", more="default: none", array="distortion")] = PlumbBob()
    kind = "pinhole"

    def __post_init__(self):
        numbers(self, "projection.")

    @classmethod
    def from_fov(cls, rows: int, cols: int, fov_deg: float = DEFAULT_FOV_DEG) -> "Pinhole":
        """Square pixels, principal point in the middle, `fov_deg` degrees across the larger side."""
        require(0 < fov_deg < 180, "fov_deg", fov_deg, "an angle between 0 and 180 degrees")
        focal = max(rows, cols) / 2 / np.tan(np.radians(fov_deg) / 2)
        return cls(focal, focal, (cols - 1) / 2, (rows - 1) / 2)

    def check(self, rows: int, cols: int) -> None:
        """Raise InvalidInput unless the distortion is invertible in all of an image of this size."""
        if self.distortion:
            x, y = self._places(rows, cols)     # the border suffices: `check` follows lines from the centre
            self.distortion.undistorted(*(np.concatenate([v[0], v[-1], v[:, 0], v[:, -1]]) for v in (x, y)))

    def rays(self, rows: int, cols: int) -> np.ndarray:
        """Unit rays, float32 [rows, cols, 3], of an image that `check` accepts."""
        x, y = self._places(rows, cols)
        if self.distortion:
            x, y = self.distortion.undistorted(x, y)
        return _unit(x, y, np.ones((rows, cols)))

    @property
    def lens(self) -> np.ndarray:
        """As kernels read it (`kernels.lens`), float32 [10]."""
        bend = self.distortion
        return np.array([self.fx, self.fy, self.cx, self.cy, bend.k1, bend.k2, bend.p1, bend.p2, bend.k3, bend.reach],
                        np.float32)

    def cropped(self, first_row: int, first_col: int) -> "Pinhole":
        """The same camera whose pixel (0, 0) is (first_row, first_col) of this one."""
        return replace(self, cx=self.cx - first_col, cy=self.cy - first_row)

    def _places(self, rows: int, cols: int) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the pixels' centres, in focal lengths from the principal point; float64 [rows, cols] each."""
        x = (np.arange(cols) - self.cx) / self.fx
        y = (np.arange(rows) - self.cy) / self.fy
        return np.broadcast_to(x, (rows, cols)), np.broadcast_to(y[:, None], (rows, cols))


@documented
@dataclass(frozen=True)
class AngularScan:
    """A scanner with evenly spaced angles: x forward, y left, z up (REP-103).

    Azimuth from the column, elevation from the row.
    """

    azimuth_start_rad: Annotated[float, Key("of column 0, positive to the left", "rad", ANGLES_RAD)]
    azimuth_step_rad: Annotated[float, Key("from column to column", "rad", ANGLES_RAD)]
    elevation_start_rad: Annotated[float, Key("of row 0, positive up", "rad", ANGLES_RAD)]
    elevation_step_rad: Annotated[float, Key("from row to row", "rad", ANGLES_RAD)]
    kind = "angular_scan"

    def __post_init__(self):
        numbers(self, "projection.")

    def rays(self, rows: int, cols: int) -> np.ndarray:
        """Unit rays, float32 [rows, cols, 3]."""
        azimuth = self.azimuth_start_rad + self.azimuth_step_rad * np.arange(cols)
        elevation = (self.elevation_start_rad + self.elevation_step_rad * np.arange(rows))[:, None]
        z = np.broadcast_to(np.sin(elevation), (rows, cols))
        return _unit(np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), z)

    @property
    def lens(self) -> np.ndarray:
        """As kernels read it (`kernels.lens`), float32 [4]."""
        # A line scan has no step across: use the step along it. A single beam: use 1 rad.
        azimuth_step = self.azimuth_step_rad or abs(self.elevation_step_rad) or 1.0
        elevation_step = self.elevation_step_rad or abs(self.azimuth_step_rad) or 1.0
        return np.array([self.azimuth_start_rad, azimuth_step, self.elevation_start_rad, elevation_step], np.float32)

    def cropped(self, first_row: int, first_col: int) -> "AngularScan":
        """The same scan whose pixel (0, 0) is (first_row, first_col) of this one."""
        return replace(self, azimuth_start_rad=self.azimuth_start_rad + first_col * self.azimuth_step_rad,
                       elevation_start_rad=self.elevation_start_rad + first_row * self.elevation_step_rad)


Projection = Pinhole | AngularScan


def _unit(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    ray = np.stack([x, y, z], axis=-1)
    return (ray / np.linalg.norm(ray, axis=-1, keepdims=True)).astype(np.float32)
