"""FrameLog: log clouds, images, scalars and log lines to files and to the live server. Not thread-safe."""

import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.colours import RANGE_MAP, AdaptiveRange, levels, packed, range_table, visible_table
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.projection import Projection
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.viewpoint import Viewpoint, look_at, point_radius_m, sensor_axes
from srt3d_ros.recording import schema
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles, still_blueprint
from srt3d_ros.recording.rerun_streams import send_blueprint
from srt3d_ros.recording.rrd_file import RrdFile

COLOUR_BY = ("range", "intensity", "height", "depth_std")
_COLOURS = 64           # distinct ones: more look the same and cost a byte per point
_RADIUS_SAMPLES = 4096
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # of the viewer's 3D view, on a wide screen
_CLOUD_APPLICATION_ID = "srt3d_ros_cloud"   # the viewer keeps one blueprint for each application


@dataclass(frozen=True)
class Colouring:
    """How points are coloured."""

    by: str = COLOUR_BY[0]
    map: str = RANGE_MAP            # one of colours.COLOUR_MAPS
    fixed_range: tuple[float, float] | None = None      # in photons or metres; None: follow the clouds slowly


@dataclass(frozen=True)
class Style:
    """How clouds and images are recorded."""

    colouring: Colouring = Colouring()
    exact: bool = False             # keep the order of points and float32 values, in a file half as large again
    blueprint: Callable[..., rrb.Blueprint] = film_blueprint        # from eye, sensor and the names of the images


class FrameLog:
    """Logs frames to every stream that `begin` has added.

    Args:
        sensor: sets the axes, the size of the points and the precision of the depth image.
        properties: of the recording: {"run": {…}, …}.
        images: entity paths of the images that will be logged, for the blueprint.
        style: how clouds and images are recorded.
    """

    def __init__(self, sensor: SensorModel | None, properties: Mapping[str, Mapping], images: tuple[str, ...],
                 style: Style):
        self.streams: list[rr.RecordingStream] = []
        self._sensor, self._style, self._images = sensor, style, images
        self._properties = {name: dict(facts) for name, facts in properties.items()}
        self._projection = sensor.projection if sensor else None
        self._colours = _CloudColours(style.colouring, self._projection)
        self._depth_range, self._in_mm = AdaptiveRange(), schema.fits_mm(sensor) and not style.exact
        self._image_ranges: dict[str, AdaptiveRange] = {}
        self._eye: Viewpoint | None = None
        self._field_of_view: list = []

    def begin(self, stream: rr.RecordingStream) -> None:
        """Add a stream: log the static entities and properties to it now, and all that follows."""
        stream.log("/", schema.view_coordinates(self._sensor), static=True)
        stream.log(schema.NO_DEPTH, schema.no_depth_colour(), static=True)
        for path, style in plot_styles().items():
            stream.log(path, style, static=True)
        for name, facts in self._properties.items():
            schema.log_properties(stream, name, facts)
        if self._sensor is not None:
            schema.log_properties(stream, schema.SENSOR, schema.sensor_properties(self._sensor))
        if self._eye is not None:
            self._send_view(stream)
        self.streams.append(stream)

    def end(self, stream: rr.RecordingStream) -> None:
        """Remove a stream. A recording without a point gets its blueprint now."""
        self.streams.remove(stream)
        if self._eye is None:
            self._choose_view(np.empty((0, 3)))
            self._send_view(stream)
            self._eye = None

    def set_properties(self, name: str, facts: Mapping) -> None:
        """Set facts of one of the recording's properties, here and in all files that follow."""
        self._properties.setdefault(name, {}).update(facts)
        for stream in self.streams:
            schema.log_properties(stream, name, facts)

    def cloud(self, stamp_ns: int, frame_index: int, columns: Mapping[str, np.ndarray]) -> None:
        """Log a cloud; columns as for schema.points, in arrays that no longer change."""
        if not self.streams:        # spare the sorting
            return
        xyz = columns["xyz"]
        if len(xyz) and self._eye is None:
            self._choose_view(xyz)
            for stream in self.streams:
                self._send_view(stream)
        colour = self._colours(columns)
        if not self._style.exact:
            columns, colour = schema.sorted_to_compress(columns, colour)
        sample = xyz[:: max(len(xyz) // _RADIUS_SAMPLES, 1)]
        radius_m = point_radius_m(sample, self._sensor) if self._sensor else 0.0
        archetypes = schema.points(columns, colour, radius_m, self._style.exact)
        self.log(stamp_ns, frame_index, {schema.POINTS: archetypes})

    def depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """Log a depth image, float32, in an array that no longer changes."""
        low, high = self._depth_range.update(depth_m)
        self.log(stamp_ns, frame_index, {schema.DEPTH: [schema.depth_image(depth_m, low, high, self._in_mm)],
                                          schema.NO_DEPTH: [schema.no_depth(depth_m)]})

    def image(self, path: str, stamp_ns: int, frame_index: int, photons: np.ndarray) -> None:
        """Log one of schema.IMAGES: integers, or float32 with NaN = none, in an array that no longer changes."""
        low, high = self._image_ranges.setdefault(path, AdaptiveRange()).update(photons)
        self.log(stamp_ns, frame_index, {path: [schema.photon_image(photons, low, high, self._style.exact)]})

    def log(self, stamp_ns: int, frame_index: int | None, archetypes: Mapping[str, list]) -> None:
        """Log archetypes by entity path."""
        for stream in self.streams:
            stream.reset_time()
            stream.set_time(schema.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
            if frame_index is not None:
                stream.set_time(schema.FRAME, sequence=int(frame_index))
            for path, of_path in archetypes.items():
                stream.log(path, *of_path)

    def _choose_view(self, xyz: np.ndarray) -> None:
        self._eye = look_at(xyz, self._projection, fov_deg=_VIEWER_FOV_DEG, aspect=_VIEW_ASPECT)
        if self._sensor is not None:
            self._field_of_view = schema.field_of_view(self._sensor, xyz)

    def _send_view(self, stream: rr.RecordingStream) -> None:
        if self._field_of_view:
            stream.log(schema.SENSOR_PATH, *self._field_of_view, static=True)
        send_blueprint(stream, self._style.blueprint(self._eye, self._sensor, self._images))


class _CloudColours:
    """Computes the colours of one cloud after the other; `projection` says which way is up."""

    def __init__(self, colouring: Colouring, projection: Projection | None):
        table = range_table if colouring.by == "range" else visible_table
        self._by, self._table = colouring.by, packed(table(colouring.map, _COLOURS))
        self._up = sensor_axes(projection)[2].astype(np.float32)
        self._range = AdaptiveRange(fixed=colouring.fixed_range)

    def __call__(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """uint32 [N], 0xRRGGBBAA. By the intensity where the quantity to colour by is missing."""
        by = self._by if self._by in ("height", "range", *columns) else "intensity"
        if by == "height":
            values = columns["xyz"] @ self._up
        else:
            values = np.linalg.norm(columns["xyz"], axis=1) if by == "range" else columns[by]
        low, high = self._range.update(values)
        return self._table[levels(values, low, high, root=by == "intensity")]


def save_cloud(cloud: PointCloud, path: Path, sensor: SensorModel, properties: dict) -> None:
    """Write a cloud and its depth image to an .rrd file, every value exactly; OSError if it cannot be written."""
    log = FrameLog(sensor, {schema.RUN: properties}, (schema.DEPTH,), Style(exact=True, blueprint=still_blueprint))
    file = RrdFile(path, _CLOUD_APPLICATION_ID, str(uuid.uuid4()))
    log.begin(file.stream)
    columns = {"xyz": cloud.xyz, "intensity": cloud.intensity, "row": cloud.row, "col": cloud.col,
               "surface": cloud.surface, "depth_std": cloud.depth_std_bins * sensor.bin_width_m}
    log.cloud(cloud.stamp_ns, 0, columns)
    log.depth(cloud.stamp_ns, 0, cloud.depth_image(sensor.projection))
    log.end(file.stream)
    file.close()
