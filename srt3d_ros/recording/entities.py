"""What a recording holds: names of entities and components, and how values become rerun archetypes and back."""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.pictures.colours import BACKGROUND as BLACK
from srt3d_ros.pictures.colours import PHOTON_MAP, RANGE_MAP
from srt3d_ros.pictures.viewpoint import sensor_axes

APPLICATION_ID = "srt3d_ros"
STAMP, FRAME = "stamp", "frame"                     # timelines
POINTS, DEPTH, METRICS, LOG, SENSOR_PATH = "/points", "/depth", "/metrics", "/log", "/sensor"
NO_DEPTH = f"{DEPTH}/none"                          # drawn over the depth image
IMAGES = INTENSITY_IMAGE, BACKGROUND, PHOTONS = "/intensity", "/background", "/photons"     # all in photons
INTENSITY = "intensity"                             # component beside the points: photons
OF_FULL_CLOUDS = ("depth_std", "row", "col", "surface")     # components of clouds that have them
RUN, SENSOR, VERSIONS = "run", "sensor", "versions"      # properties
PROPERTIES = "/__properties"                        # rerun's entity path of properties

_DARK = 45 / 210        # dark colours that colours.range_table leaves out, over those that it has
_LEAST_SPAN = 1e-6
_FRUSTUM = (110, 120, 140)


def points(columns: Mapping[str, np.ndarray], colour: np.ndarray, radius_m: float) -> list:
    """The archetypes of a cloud. rerun does not copy the arrays: they must not change afterwards.

    Args:
        columns: xyz float32 [N, 3], contiguous, metres; intensity float32 [N]; and any of OF_FULL_CLOUDS.
        colour: uint32 [N], 0xRRGGBBAA.
        radius_m: of the discs; 0 for a size on the screen.
    """
    # As Arrow arrays: rerun cannot infer the type of an empty NumPy array here, and warns.
    values = {name: pa.array(column) for name, column in columns.items() if name == INTENSITY or name in OF_FULL_CLOUDS}
    radius = radius_m or rr.Radius.ui_points(1.5)
    return [rr.Points3D(columns["xyz"], colors=colour, radii=radius), rr.AnyValues(**values)]


def image(path: str, values: np.ndarray, low: float, high: float) -> dict[str, list]:
    """The archetypes, by entity path, of an image [rows, cols], NaN = none, coloured from `low` to `high`.

    DEPTH in metres, in the colours of ranges, with a mask over it that makes pixels without depth black: its map has a
    colour for any value. Others in photons, integers in the fewest bytes; as DepthImage, too, because rerun colours
    only these by a map and shows their values.
    """
    if path == DEPTH:
        ends = high + _DARK * (high - low), low     # the far end first: rerun then turns the map round
        mask = rr.SegmentationImage((~np.isfinite(values)).astype(np.uint8), opacity=1, draw_order=1)
        return {DEPTH: [rr.DepthImage(values, meter=1, colormap=RANGE_MAP, depth_range=ends)], NO_DEPTH: [mask]}
    if values.dtype.kind == "u":
        values = values.astype(np.min_scalar_type(values.max(initial=0)))
    return {path: [rr.DepthImage(values, colormap=PHOTON_MAP, depth_range=(low, max(high, low + _LEAST_SPAN)))]}


def no_depth_colour() -> rr.AnnotationContext:
    """The static colours of the mask NO_DEPTH."""
    return rr.AnnotationContext([(0, None, (0, 0, 0, 0)), (1, "no point", (*BLACK, 255))])


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


def view_coordinates(sensor: SensorModel) -> rr.ViewCoordinates:
    """Which way the axes of the sensor's frame point: FLU for a scanner, else RDF."""
    forward = sensor_axes(sensor.projection)[0]
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
