"""A measured scene to simulate from: an .npz file of depth, reflectivity and which pixels are valid."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.files import read_npz_arrays, require_file
from srt3d_ros.datasets.scene import StaticScene, default_sensor
from srt3d_ros.errors import require

SIZE = 141      # pixels along the larger side, as the head that the SRT3D paper uses


def read_scene(path: str | Path, size: int = SIZE) -> tuple[StaticScene, SensorModel]:
    """The scene of a file, and the default sensor fitted to it: T = 4613 bins of 0.3 mm around the scene's depths.

    The file has `depth_m` [rows, cols], metres along the rays, NaN or 0 = unknown, and may have `reflectivity` (the
    same shape, 0 or more; 1 if absent) and `valid` (bool; pixels that are not see no surface). It is thinned to `size`
    pixels along its larger side by taking the nearest ones, so that no depth is made up.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    path = Path(path)
    require_file(path, "scene")
    arrays = read_npz_arrays(path, ("depth_m", "reflectivity", "valid"))
    require("depth_m" in arrays, f"{path.name} depth_m", "missing", "the array depth_m [rows, cols], metres")
    depth_m = _image(arrays, "depth_m", path.name, arrays["depth_m"].shape)
    reflectivity = _image(arrays, "reflectivity", path.name, depth_m.shape, 1.0)
    valid = _image(arrays, "valid", path.name, depth_m.shape, True).astype(bool)
    require(bool((reflectivity[valid] >= 0).all()), f"{path.name} reflectivity", "negative or NaN in places",
            "0 or more")
    seen = valid & np.isfinite(depth_m) & (depth_m > 0)
    require(bool(seen.any()), f"{path.name} depth_m", "unknown everywhere", "some depths above 0 m")
    chosen = np.ix_(*(_thin(side, size, max(depth_m.shape)) for side in depth_m.shape))
    depth_m = np.where(seen, depth_m, np.nan)[chosen]
    sensor = _around(depth_m, path.name)
    return StaticScene(depth_m, np.where(np.isfinite(depth_m), reflectivity[chosen], 0)), sensor


def _around(depth_m: np.ndarray, name: str) -> SensorModel:
    """The default sensor with as many pixels, its bins centred on these depths."""
    sensor, (rows, cols) = default_sensor(), depth_m.shape
    near_m, far_m = float(np.nanmin(depth_m)), float(np.nanmax(depth_m))
    period_m = sensor.num_bins * sensor.bin_width_m
    require(far_m - near_m < period_m, f"{name} depth_m", f"{near_m:.3g} to {far_m:.3g} m",
            f"a span below {period_m:.3g} m (T = {sensor.num_bins} bins)")
    offset_bins = max(round((near_m + far_m - period_m) / 2 / sensor.bin_width_m), 0)
    return sensor.replace(rows=rows, cols=cols, toa_offset_bins=offset_bins,
                          projection=Pinhole.from_fov(rows, cols, fov_deg=11.0))


def _thin(side: int, size: int, larger: int) -> np.ndarray:
    """Indices of the pixels to keep of a side, so that the larger side keeps `size` at most."""
    kept = max(round(side * min(size / larger, 1)), 1)
    return ((np.arange(kept) + 0.5) * side / kept).astype(int)


def _image(arrays: dict[str, np.ndarray], name: str, file: str, shape: tuple[int, ...], absent=None) -> np.ndarray:
    if name not in arrays:
        return np.full(shape, absent)
    image = arrays[name]
    require(image.dtype.kind in "iufb" and image.ndim == 2 and image.shape == shape and image.size > 0,
            f"{file} {name}", f"{image.dtype} {image.shape}", "numbers [rows, cols], all arrays of one shape")
    return image if name == "valid" else image.astype(np.float64)
