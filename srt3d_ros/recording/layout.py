"""What a recording holds and under which names: shared by the writer, the blueprint and the reader."""

from collections.abc import Mapping
from dataclasses import astuple, is_dataclass

import numpy as np
import pyarrow as pa
import rerun as rr

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording.compact import halved, to_noise
from srt3d_ros.viewpoint import sensor_axes

APPLICATION_ID = "srt3d_ros"
STAMP, FRAME = "stamp", "frame"                     # timelines
POINTS, DEPTH, METRICS, LOG, SENSOR_PATH = "/points", "/depth", "/metrics", "/log", "/sensor"
IMAGES = INTENSITY_IMAGE, BACKGROUND, PHOTONS = "/intensity", "/background", "/photons"     # all in photons
INTENSITY = "intensity"                             # component beside the points: photons
OF_FULL_CLOUDS = ("depth_std", "row", "col", "surface")     # components of clouds that have them
RUN, SENSOR, PARAMETERS, VERSIONS = PROPERTY_NAMES = "run", "sensor", "parameters", "versions"      # properties
PROPERTIES = "/__properties"                        # where rerun keeps them

_MM_PER_M = 1000
_MOST_MM = np.iinfo(np.uint16).max
_NONE_MARGIN = 0.2                                  # of the depth range, kept free: "none" has a colour of its own
_PHOTON_MAP, _LEAST_SPAN = "inferno", 1e-6
_FRUSTUM = (110, 120, 140)
_LEVELS = {10: "DEBUG", 20: "INFO", 30: "WARN", 40: "ERROR", 50: "CRITICAL"}      # of rcl_interfaces/Log


def points(columns: Mapping[str, np.ndarray], colour: np.ndarray, radius_m: float, exact: bool) -> list:
    """What is logged for a cloud; the arrays must not change afterwards (rerun does not copy them).

    Args:
        columns: xyz float32 [N, 3], contiguous, metres; intensity float32 [N]; and those of OF_FULL_CLOUDS that are
            there.
        colour: uint32 [N], 0xRRGGBBAA.
        radius_m: of the discs; 0 for a size on the screen.
        exact: intensity and depth_std as they are; in 11 bits otherwise.
    """
    # As Arrow arrays: rerun cannot tell the type of an empty NumPy array here, and warns.
    values = {name: pa.array(halved(column) if column.dtype == np.float32 and not exact else column)
              for name, column in columns.items() if name == INTENSITY or name in OF_FULL_CLOUDS}
    radius = radius_m or rr.Radius.ui_points(1.5)
    return [rr.Points3D(columns["xyz"], colors=colour, radii=radius), rr.AnyValues(**values)]


def photon_image(photons: np.ndarray, low: float, high: float, exact: bool) -> rr.DepthImage:
    """What is logged for an image [rows, cols] in photons, NaN = none, coloured from `low` to `high`.

    A DepthImage: of rerun's images only these have a colour map and a range, and tell their values. Integers are kept
    in 8 or 16 bits; other values in 11 bits and to a third of the photons' noise, unless `exact`.
    """
    if photons.dtype.kind == "u":
        photons = photons.astype(np.min_scalar_type(photons.max(initial=0)))
    elif not exact:
        photons = halved(to_noise(photons))
    return rr.DepthImage(photons, colormap=_PHOTON_MAP, depth_range=(low, max(high, low + _LEAST_SPAN)))


def log_line(text: str, level: int) -> rr.TextLog:
    """A line of a node's log; the level as in rcl_interfaces/Log."""
    return rr.TextLog(text, level=_LEVELS.get(level, "INFO"))


def view_of(sensor: SensorModel, xyz: np.ndarray) -> list:
    """What is logged for the sensor: where it is, and what it sees, as far as the points [N, 3] of a cloud reach."""
    length_m = float(np.percentile(np.linalg.norm(xyz, axis=1), 99)) if len(xyz) else 1.0
    here = rr.Transform3D(translation=[0, 0, 0])
    if isinstance(lens := sensor.projection, Pinhole):
        # rerun's pixels have their corner at (0, 0), ours their centre.
        return [here, rr.Pinhole(focal_length=[lens.fx, lens.fy], principal_point=[lens.cx + 0.5, lens.cy + 0.5],
                                 resolution=[sensor.cols, sensor.rows], camera_xyz=rr.ViewCoordinates.RDF,
                                 image_plane_distance=length_m, color=_FRUSTUM, line_width=rr.Radius.ui_points(1))]
    border = np.concatenate([sensor.rays[0], sensor.rays[:, -1], sensor.rays[-1, ::-1], sensor.rays[::-1, 0]])
    corners = sensor.rays[[0, 0, -1, -1], [0, -1, -1, 0]]
    lines = [length_m * border, *(length_m * np.stack([np.zeros(3), corner]) for corner in corners)]
    return [here, rr.LineStrips3D(lines, colors=_FRUSTUM, radii=rr.Radius.ui_points(1))]


def depth_image(depth_m: np.ndarray, low: float, high: float, in_mm: bool) -> rr.DepthImage:
    """A depth image [rows, cols] in metres, NaN = none, coloured from `low` to `high` metres.

    Whole millimetres in 16 bits (0 = none) if `in_mm`, half the size; otherwise as they are.
    """
    low -= _NONE_MARGIN * (high - low)
    if not in_mm:
        return rr.DepthImage(depth_m, meter=1, colormap="viridis", depth_range=(low, high))
    mm = np.nan_to_num(np.rint(depth_m * _MM_PER_M), nan=0, posinf=0, neginf=0)
    mm = np.clip(mm, 0, _MOST_MM).astype(np.uint16)
    return rr.DepthImage(mm, meter=_MM_PER_M, colormap="viridis", depth_range=(low * _MM_PER_M, high * _MM_PER_M))


def metres(buffer: np.ndarray, shape: tuple[int, int], units_per_m: float) -> np.ndarray:
    """The depth image [rows, cols] that a logged buffer of bytes holds, float32 metres, NaN = none."""
    if units_per_m == 1:
        return buffer.view(np.float32).reshape(shape)
    units = buffer.view(np.uint16).reshape(shape)
    return np.where(units == 0, np.float32(np.nan), units / np.float32(units_per_m))


def fits_mm(sensor: SensorModel | None) -> bool:
    """True if every range the sensor can see is below 65.5 m and above 0."""
    return sensor is not None and 0 < sensor.range_m(0) + 1 and sensor.range_m(sensor.num_bins) * _MM_PER_M < _MOST_MM


def metric_path(name: str) -> str:
    """Where a scalar is logged: `latency_ms` at /metrics/latency_ms, `latency_ms/sketch` below it."""
    return f"{METRICS}/{name}"


def view_coordinates(sensor: SensorModel | None) -> rr.ViewCoordinates:
    """Which way the axes of the sensor's frame point."""
    forward = sensor_axes(sensor.projection if sensor else None)[0]
    return rr.ViewCoordinates.FLU if forward[0] else rr.ViewCoordinates.RDF


def tell(stream: rr.RecordingStream, name: str, facts: Mapping) -> None:
    """Set facts of one of a recording's properties: numbers, texts and lists as they are, the rest as text.

    None and empty lists are left out: rerun cannot tell their types, and warns where nothing else is told.
    """
    kept = (bool, int, float, str, list, tuple, np.generic, np.ndarray)
    values = {name: value if isinstance(value, kept) else str(value) for name, value in facts.items()
              if value is not None and np.size(value)}
    if values:
        stream.send_property(name, rr.AnyValues(**values))


def sensor_properties(sensor: SensorModel) -> dict:
    """The sensor, as far as a recording tells it."""
    facts = {name: getattr(sensor, name) for name in ("rows", "cols", "num_bins", "bin_width_s", "irf_ref",
                                                      "toa_offset_bins", "range_offset_m", "frame_id",
                                                      "toa_reference")}
    facts["projection"] = sensor.projection.kind
    facts |= {name: list(astuple(value)) if is_dataclass(value) else float(value)
              for name, value in vars(sensor.projection).items()}
    if sensor.irf.ndim == 1:
        facts["irf"] = sensor.irf
    return facts
