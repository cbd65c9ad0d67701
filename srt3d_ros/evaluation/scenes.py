"""The scenes that are simulated beside the bust: a net, and those of files."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.files import read_errors, read_npz_arrays
from srt3d_ros.datasets.simulation.scene import StaticScene, default_sensor
from srt3d_ros.errors import require

SIZE = 141      # pixels along the larger side of a scene from a file, as the head that the SRT3D paper uses


class NetScene:
    """A camouflage net that waves before a plane: two surfaces in most pixels, one where the net is dense or open."""

    net_m, plane_m = 2.0, 3.2           # along the optical axis

    def __init__(self, sensor: SensorModel):
        self._rays = sensor.rays.astype(np.float64)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Net and plane at time `t_s`; see Scene."""
        x, y, z = np.moveaxis(self._rays, -1, 0)
        u, v = x / z * self.net_m, y / z * self.net_m                 # where the ray meets the net
        wave = 0.08 * np.sin(2 * np.pi * (1.3 * u + 0.7 * v - 0.4 * t_s))
        cover = np.clip(0.5 + 0.45 * np.sin(17 * u + 2 * np.sin(9 * v)) + 0.25 * np.sin(23 * v - 5 * u), 0, 1)
        range_m = np.stack([(self.net_m + wave) / z, self.plane_m / z])
        reflectivity = np.stack([cover, 1 - cover])
        range_m[reflectivity <= 0] = np.nan
        return range_m.astype(np.float32), reflectivity.astype(np.float32)


def net_sensor() -> SensorModel:
    """A sensor for NetScene: 32×32 pixels, 10°, T = 153 bins of 37.5 mm, as the paper's camouflage data."""
    bin_width_s = 250e-12
    response = irf.spad(bin_width_s, fwhm_s=500e-12, tail_s=300e-12, tail_share=0.2)
    return SensorModel(rows=32, cols=32, num_bins=153, bin_width_s=bin_width_s, irf=response,
                       projection=Pinhole.from_fov(32, 32, fov_deg=10.0))


def read_scene(path: str | Path) -> tuple[StaticScene, SensorModel]:
    """The scene of a file, and the default sensor fitted to it: T = 4613 bins of 0.3 mm around the scene's depths.

    The file has `depth_m` [rows, cols], metres along the rays, NaN or 0 = unknown, and may have `reflectivity` (the
    same shape, 0 or more; 1 if absent) and `valid` (bool; pixels that are not see no surface). It is thinned to SIZE
    pixels along its larger side by taking the nearest ones, so that no depth is made up.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    path = Path(path)
    arrays = read_npz_arrays(path, ("depth_m", "reflectivity", "valid"), "scene")
    with read_errors(path):
        require("depth_m" in arrays, "depth_m", "missing", "the array depth_m [rows, cols], metres")
        shape = arrays["depth_m"].shape
        for name, image in arrays.items():
            fits = image.dtype.kind in "iufb" and image.ndim == 2 and image.shape == shape and image.size > 0
            require(fits, name, f"{image.dtype} {image.shape}", "numbers [rows, cols], all arrays of one shape")
        depth_m = arrays["depth_m"].astype(np.float64)
        reflectivity = arrays.get("reflectivity", np.ones(shape)).astype(np.float64)
        valid = arrays.get("valid", np.ones(shape)).astype(bool)
        require(bool((reflectivity[valid] >= 0).all()), "reflectivity", "negative or NaN in places", "0 or more")
        seen = valid & np.isfinite(depth_m) & (depth_m > 0)
        require(bool(seen.any()), "depth_m", "unknown everywhere", "some depths above 0 m")
        chosen = np.ix_(*(_thinned(side, max(shape)) for side in shape))
        depth_m = np.where(seen, depth_m, np.nan)[chosen]
        sensor = _around(depth_m)
    return StaticScene(depth_m, np.where(np.isfinite(depth_m), reflectivity[chosen], 0)), sensor


def _around(depth_m: np.ndarray) -> SensorModel:
    """The default sensor with as many pixels, its bins centred on these depths."""
    sensor, (rows, cols) = default_sensor(), depth_m.shape
    near_m, far_m = float(np.nanmin(depth_m)), float(np.nanmax(depth_m))
    period_m = sensor.num_bins * sensor.bin_width_m
    require(far_m - near_m < period_m, "depth_m", f"{near_m:.3g} to {far_m:.3g} m",
            f"a span below {period_m:.3g} m (T = {sensor.num_bins} bins)")
    offset_bins = max(round((near_m + far_m - period_m) / 2 / sensor.bin_width_m), 0)
    return sensor.replace(rows=rows, cols=cols, toa_offset_bins=offset_bins,
                          projection=Pinhole.from_fov(rows, cols, fov_deg=11.0))


def _thinned(side: int, larger: int) -> np.ndarray:
    """Indices of the pixels to keep of a side, so that the larger side keeps SIZE at most."""
    kept = max(round(side * min(SIZE / larger, 1)), 1)
    return ((np.arange(kept) + 0.5) * side / kept).astype(int)
