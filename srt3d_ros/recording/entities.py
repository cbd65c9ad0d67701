"""Names of a recording's entities and components, and the rerun archetypes of its values."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.pictures.colours import BACKGROUND as BLACK
from srt3d_ros.pictures.colours import ORANGE, PHOTON_MAP, RANGE_MAP
from srt3d_ros.pictures.viewpoint import sensor_axes

APPLICATION_ID = "srt3d_ros"
STAMP, FRAME_INDEX = "stamp", "frame"               # timelines
POINTS_PATH, DEPTH_PATH, METRICS_PATH, SENSOR_PATH = "/points", "/depth", "/metrics", "/sensor"
FREE_PATH = "/free"                                 # empty rays, hidden until someone shows them
POSE_PATH, ROOM_PATH, WAY_PATH = "/pose", "/room", "/way"           # of a sensor that moves: the last two fixed
MOVING_SENSOR_PATH = f"{POSE_PATH}{SENSOR_PATH}"
NO_DEPTH = f"{DEPTH_PATH}/none"                     # drawn over the depth image
PHOTON_IMAGES = INTENSITY_PATH, BACKGROUND_PATH, PHOTONS_PATH = "/intensity", "/background", "/photons"     # photons
IMAGE_TITLES = {DEPTH_PATH: "Depth", PHOTONS_PATH: "Photons", INTENSITY_PATH: "Intensity",
                BACKGROUND_PATH: "Background"}
INTENSITY_COMPONENT = "intensity"                   # component of points, in photons
OF_FULL_CLOUDS = ("depth_std", "row", "col", "surface")     # optional components of points; depth_std in metres
RUN, SENSOR_PROPERTY, VERSIONS = "run", "sensor", "versions"      # properties
PROPERTIES = "/__properties"                        # rerun's entity path for properties

_DARK = 45 / 210        # ratio of dark colours that RANGE_TABLE leaves out to those that it keeps
_LEAST_SPAN = 1e-6
_FAN, MOST_RAYS = (38, 52, 60), 300                # dim and few, or they would hide the points
_WAY_WIDTH = rr.Radius.ui_points(1.5)
_FRUSTUM, _FRUSTUM_WIDTH = (60, 66, 77), rr.Radius.ui_points(0.4)      # dim and thin, behind the points


def rgba(colour: str) -> int:
    """0xRRGGBBAA of an opaque colour, "#rrggbb"."""
    return int(f"{colour[1:]}ff", 16)


def points(columns: Mapping[str, np.ndarray], colour: np.ndarray, radius_m: float) -> list:
    """Archetypes of a cloud. rerun does not copy the arrays: do not change them afterwards.

    Args:
        columns: xyz float32 [N, 3], contiguous, metres; intensity float32 [N]; and any of OF_FULL_CLOUDS.
        colour: uint32 [N], 0xRRGGBBAA.
        radius_m: radius of the points; 0 for a fixed size on the screen.
    """
    # Arrow arrays, because rerun 0.41 cannot infer the type of an empty NumPy array and warns.
    values = {name: pa.array(column) for name, column in columns.items()
              if name == INTENSITY_COMPONENT or name in OF_FULL_CLOUDS}
    radius = radius_m or rr.Radius.ui_points(1.5)
    return [rr.Points3D(columns["xyz"], colors=colour, radii=radius), rr.AnyValues(**values)]


def fan(ends: np.ndarray) -> list:
    """Archetypes of empty rays from the sensor to their ends [N, 3], of at most MOST_RAYS of them."""
    ends = ends[::max(-(-len(ends) // MOST_RAYS), 1)]
    return [rr.LineStrips3D(np.stack([np.zeros_like(ends), ends], axis=1), colors=_FAN, radii=_FRUSTUM_WIDTH)]


def pose(pose: Pose, last: Pose) -> dict[str, list]:
    """Archetypes by entity path of the sensor's pose, and of its way from the last one."""
    way = rr.LineStrips3D([np.stack([last.translation, pose.translation])], colors=rgba(ORANGE), radii=_WAY_WIDTH)
    place = rr.Transform3D(translation=pose.translation, quaternion=rr.Quaternion(xyzw=pose.quaternion))
    return {POSE_PATH: [place], WAY_PATH: [way]}


def image(path: str, values: np.ndarray, low: float, high: float) -> dict[str, list]:
    """Archetypes by entity path of an image [rows, cols], NaN = none, coloured from `low` to `high`.

    DEPTH_PATH is in metres, with a mask that makes pixels without depth black. The others are in photons; they are
    DepthImages, too, because rerun applies colour maps only to these.
    """
    if path == DEPTH_PATH:
        ends = high + _DARK * (high - low), low     # the far end first, which reverses the colour map
        mask = rr.SegmentationImage((~np.isfinite(values)).astype(np.uint8), opacity=1, draw_order=1)
        return {DEPTH_PATH: [rr.DepthImage(values, meter=1, colormap=RANGE_MAP, depth_range=ends)], NO_DEPTH: [mask]}
    if values.dtype.kind == "u":
        values = values.astype(np.min_scalar_type(values.max(initial=0)))
    return {path: [rr.DepthImage(values, colormap=PHOTON_MAP, depth_range=(low, max(high, low + _LEAST_SPAN)))]}


def no_depth_colour() -> rr.AnnotationContext:
    """Colours of the mask NO_DEPTH."""
    return rr.AnnotationContext([rr.AnnotationInfo(0, color=(0, 0, 0, 0)), rr.AnnotationInfo(1, "no point", BLACK)])


def field_of_view(sensor: SensorModel, xyz: np.ndarray) -> rr.LineStrips3D:
    """The edges of what the sensor sees, up to the 99th percentile range of points [N, 3]."""
    length_m = float(np.percentile(np.linalg.norm(xyz, axis=1), 99)) if len(xyz) else 1.0
    rays = length_m * sensor.rays
    border = np.concatenate([rays[0], rays[:, -1], rays[-1, ::-1], rays[::-1, 0]])
    corners = ([np.zeros(3), corner] for corner in rays[[0, 0, -1, -1], [0, -1, -1, 0]])
    return rr.LineStrips3D([border, *corners], colors=_FRUSTUM, radii=_FRUSTUM_WIDTH)


def view_coordinates(sensor: SensorModel) -> rr.AsComponents:
    """Axes of the sensor's frame: FLU for a scanner, else RDF."""
    forward = sensor_axes(sensor.projection)[0]
    return rr.ViewCoordinates.FLU if forward[0] else rr.ViewCoordinates.RDF


def metric_path(name: str) -> str:
    """Entity path of a time series: /metrics/latency_ms for `latency_ms`."""
    return f"{METRICS_PATH}/{name}"


def log_properties(stream: rr.RecordingStream, name: str, facts: Mapping) -> None:
    """Set facts of a property: numbers, strings and lists as they are, others as strings; None and [] are skipped."""
    kept = (bool, int, float, str, list, tuple, np.generic, np.ndarray)
    values: dict[str, Any] = {name: value if isinstance(value, kept) else str(value) for name, value in facts.items()
              if value is not None and np.size(value)}
    if values:
        stream.send_property(name, rr.AnyValues(**values))
