"""What a recording holds: names of entities and components, and how values become rerun archetypes and back."""

from collections.abc import Mapping
from dataclasses import astuple, is_dataclass

import numpy as np
import pyarrow as pa
import rerun as rr

from srt3d_ros.colours import BACKGROUND as BLACK
from srt3d_ros.colours import PHOTON_MAP, RANGE_MAP
from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.viewpoint import sensor_axes

APPLICATION_ID = "srt3d_ros"
STAMP, FRAME = "stamp", "frame"                     # timelines
POINTS, DEPTH, METRICS, LOG, SENSOR_PATH = "/points", "/depth", "/metrics", "/log", "/sensor"
NO_DEPTH = f"{DEPTH}/none"                          # drawn over the depth image
IMAGES = INTENSITY_IMAGE, BACKGROUND, PHOTONS = "/intensity", "/background", "/photons"     # all in photons
INTENSITY = "intensity"                             # component beside the points: photons
OF_FULL_CLOUDS = ("depth_std", "row", "col", "surface")     # components of clouds that have them
RUN, SENSOR, PARAMETERS, VERSIONS = "run", "sensor", "parameters", "versions"      # properties
PROPERTIES = "/__properties"                        # rerun's entity path of properties

_MM_PER_M = 1000
_MOST_MM = np.iinfo(np.uint16).max
_LARGEST_FLOAT16 = float(np.finfo(np.float16).max)
_ROOT_STEP = 0.35       # rounding of photon images: the square root of a photon count has a noise of 0.5
_DARK = 45 / 210        # dark colours that colours.range_table leaves out, over those that it has
_LEAST_SPAN = 1e-6
_FRUSTUM = (110, 120, 140)
_SENSOR_FACTS = {"rows": int, "cols": int, "num_bins": int, "bin_width_s": float, "irf_ref": int,
                 "toa_offset_bins": float, "range_offset_m": float, "frame_id": str, "toa_reference": str}
_PROJECTIONS = {kind.kind: kind for kind in (Pinhole, AngularScan)}


def to_float16(values: np.ndarray) -> np.ndarray:
    """Values in 11 bits; float32 if one of them exceeds the largest float16, 65 504."""
    fits = np.abs(values[np.isfinite(values)]).max(initial=0) <= _LARGEST_FLOAT16
    return values.astype(np.float16 if fits else np.float32)


def sorted_to_compress(columns: Mapping[str, np.ndarray], colour: np.ndarray) -> tuple[dict, np.ndarray]:
    """The points of a cloud by colour, of one colour the dimmest first, with intensities in 11 bits; and the colours.

    LZ4 compresses what is sorted well.
    """
    intensity = to_float16(columns["intensity"])
    # The bits of float16 sort as their values do, as none is negative, and twenty times as fast.
    bits = intensity.view(np.uint16) if intensity.dtype == np.float16 else intensity
    order = np.argsort(bits, kind="stable")
    order = order[np.argsort(colour[order], kind="stable")]
    columns = {name: np.take(values, order, axis=0) for name, values in {**columns, "intensity": intensity}.items()}
    return columns, colour[order]


def points(columns: Mapping[str, np.ndarray], colour: np.ndarray, radius_m: float, exact: bool) -> list:
    """The archetypes of a cloud. rerun does not copy the arrays: they must not change afterwards.

    Args:
        columns: xyz float32 [N, 3], contiguous, metres; intensity float32 [N]; and any of OF_FULL_CLOUDS.
        colour: uint32 [N], 0xRRGGBBAA.
        radius_m: of the discs; 0 for a size on the screen.
        exact: keep intensity and depth_std in float32 instead of 11 bits.
    """
    # As Arrow arrays: rerun cannot infer the type of an empty NumPy array here, and warns.
    values = {name: pa.array(to_float16(column) if column.dtype == np.float32 and not exact else column)
              for name, column in columns.items() if name == INTENSITY or name in OF_FULL_CLOUDS}
    radius = radius_m or rr.Radius.ui_points(1.5)
    return [rr.Points3D(columns["xyz"], colors=colour, radii=radius), rr.AnyValues(**values)]


def photon_image(photons: np.ndarray, low: float, high: float, exact: bool) -> rr.DepthImage:
    """An image [rows, cols] in photons, NaN = none, coloured from `low` to `high`.

    A DepthImage, because rerun colours only these by a map and shows their values. Integers are kept in the fewest
    bytes; other values in 11 bits and rounded to a third of their photon noise, unless `exact`.
    """
    if photons.dtype.kind == "u":
        photons = photons.astype(np.min_scalar_type(photons.max(initial=0)))
    elif not exact:
        root = np.rint(np.sqrt(np.maximum(photons, 0)) / _ROOT_STEP) * _ROOT_STEP
        photons = to_float16(np.square(root, dtype=np.float32))
    return rr.DepthImage(photons, colormap=PHOTON_MAP, depth_range=(low, max(high, low + _LEAST_SPAN)))


def depth_image(depth_m: np.ndarray, low: float, high: float, in_mm: bool) -> rr.DepthImage:
    """A depth image [rows, cols] in metres, NaN = none, in the colours of ranges from `low` to `high` metres.

    With `in_mm` in whole millimetres, uint16, 0 = none: half the size.
    """
    ends = np.array([high + _DARK * (high - low), low])     # the far end first: rerun then turns the map round
    if not in_mm:
        return rr.DepthImage(depth_m, meter=1, colormap=RANGE_MAP, depth_range=ends)
    mm = np.nan_to_num(np.rint(depth_m * _MM_PER_M), nan=0, posinf=0, neginf=0)
    mm = np.clip(mm, 0, _MOST_MM).astype(np.uint16)
    return rr.DepthImage(mm, meter=_MM_PER_M, colormap=RANGE_MAP, depth_range=ends * _MM_PER_M)


def no_depth(depth_m: np.ndarray) -> rr.SegmentationImage:
    """What makes pixels without depth black, drawn over the depth image, whose map has a colour for any value."""
    return rr.SegmentationImage((~np.isfinite(depth_m)).astype(np.uint8), opacity=1, draw_order=1)


def no_depth_colour() -> rr.AnnotationContext:
    """The static colours of `no_depth`."""
    return rr.AnnotationContext([(0, None, (0, 0, 0, 0)), (1, "no point", (*BLACK, 255))])


def depth_in_metres(buffer: np.ndarray, shape: tuple[int, int], units_per_m: float) -> np.ndarray:
    """The depth image [rows, cols] in a recorded buffer of bytes, float32 metres, NaN = none."""
    if units_per_m == 1:
        return buffer.view(np.float32).reshape(shape)
    units = buffer.view(np.uint16).reshape(shape)
    return np.where(units == 0, np.float32(np.nan), units / np.float32(units_per_m))


def fits_mm(sensor: SensorModel | None) -> bool:
    """True if every range of the sensor lies between 0 and 65.5 m."""
    return sensor is not None and 0 < sensor.range_m(0) + 1 and sensor.range_m(sensor.num_bins) * _MM_PER_M < _MOST_MM


def field_of_view(sensor: SensorModel, xyz: np.ndarray) -> list:
    """The archetypes that show the sensor's position and its frustum, as far as the points [N, 3] of a cloud reach."""
    length_m = float(np.percentile(np.linalg.norm(xyz, axis=1), 99)) if len(xyz) else 1.0
    origin = rr.Transform3D(translation=[0, 0, 0])
    if isinstance(lens := sensor.projection, Pinhole):
        # rerun's pixels have their corner at (0, 0), ours their centre.
        return [origin, rr.Pinhole(focal_length=[lens.fx, lens.fy], principal_point=[lens.cx + 0.5, lens.cy + 0.5],
                                   resolution=[sensor.cols, sensor.rows], camera_xyz=rr.ViewCoordinates.RDF,
                                   image_plane_distance=length_m, color=_FRUSTUM, line_width=rr.Radius.ui_points(1))]
    border = np.concatenate([sensor.rays[0], sensor.rays[:, -1], sensor.rays[-1, ::-1], sensor.rays[::-1, 0]])
    corners = sensor.rays[[0, 0, -1, -1], [0, -1, -1, 0]]
    lines = [length_m * border, *(length_m * np.stack([np.zeros(3), corner]) for corner in corners)]
    return [origin, rr.LineStrips3D(lines, colors=_FRUSTUM, radii=rr.Radius.ui_points(1))]


def view_coordinates(sensor: SensorModel | None) -> rr.ViewCoordinates:
    """Which way the axes of the sensor's frame point: FLU for a scanner, else RDF."""
    forward = sensor_axes(sensor.projection if sensor else None)[0]
    return rr.ViewCoordinates.FLU if forward[0] else rr.ViewCoordinates.RDF


def metric_path(name: str) -> str:
    """The entity path of a time series: /metrics/latency_ms for `latency_ms`."""
    return f"{METRICS}/{name}"


def log_properties(stream: rr.RecordingStream, name: str, facts: Mapping) -> None:
    """Set facts of one of the recording's properties: numbers, strings and lists as they are, the rest as strings.

    None and empty lists are left out: rerun cannot infer their types, and warns.
    """
    kept = (bool, int, float, str, list, tuple, np.generic, np.ndarray)
    values = {name: value if isinstance(value, kept) else str(value) for name, value in facts.items()
              if value is not None and np.size(value)}
    if values:
        stream.send_property(name, rr.AnyValues(**values))


def sensor_properties(sensor: SensorModel) -> dict:
    """The facts of the property `sensor`; an IRF per pixel is left out."""
    facts = {name: getattr(sensor, name) for name in _SENSOR_FACTS} | {"projection": sensor.projection.kind}
    facts |= {name: list(astuple(value)) if is_dataclass(value) else float(value)
              for name, value in vars(sensor.projection).items()}
    return facts | ({"irf": sensor.irf} if sensor.irf.ndim == 1 else {})


def sensor_of(facts: Mapping) -> SensorModel | None:
    """The sensor of the property `sensor`, all pixels alike; None if its facts do not suffice."""
    try:
        kind = _PROJECTIONS[facts["projection"]]
        values = {name: facts[name] for name in kind.__dataclass_fields__ if name in facts}
        if "distortion" in values:
            values["distortion"] = PlumbBob(*np.atleast_1d(values["distortion"]).tolist())
        irf = np.atleast_1d(facts["irf"]) if "irf" in facts else np.ones(int(facts["irf_ref"]) + 1)
        known = {name: of_type(facts[name]) for name, of_type in _SENSOR_FACTS.items() if name in facts}
        return SensorModel(irf=irf, projection=kind(**values), **known)
    except (KeyError, TypeError, ValueError):
        return None
