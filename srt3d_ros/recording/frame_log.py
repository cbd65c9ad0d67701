"""FrameLog: log clouds, images, scalars and log lines to rerun's streams. Not thread-safe."""

import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.colours import PHOTON_MAP, RANGE_MAP, AdaptiveRange, levels, packed, range_table, visible_table
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Projection
from srt3d_ros.core.viewpoint import Viewpoint, look_at, point_radius_m, sensor_axes
from srt3d_ros.recording import rerun_streams, schema
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles, still_blueprint

COLOUR_BY = ("range", "intensity", "height", "depth_std")
_RADIUS_SAMPLES = 4096
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # of the viewer's 3D view, on a wide screen
_CLOUD_APPLICATION_ID = "srt3d_ros_cloud"   # the viewer keeps one blueprint for each application


class FrameLog:
    """Logs frames to all of its streams.

    Args:
        streams: to log to; `begin` has to be called for each.
        sensor: sets the axes and the size of the points.
        properties: of the recording: {"run": {…}, …}.
        images: entity paths of the images that will be logged, for the blueprint.
        colour_by: what the colours of the points show, one of COLOUR_BY.
        blueprint: makes it, from eye, sensor and `images`.
    """

    def __init__(self, streams: list[rr.RecordingStream], sensor: SensorModel | None,
                 properties: Mapping[str, Mapping], images: tuple[str, ...], colour_by: str = COLOUR_BY[0],
                 blueprint: Callable[..., rrb.Blueprint] = film_blueprint):
        self._streams, self._sensor, self._images, self._blueprint = streams, sensor, images, blueprint
        self._properties = {name: dict(facts) for name, facts in properties.items()}
        self._projection = sensor.projection if sensor else None
        self._colours = _CloudColours(colour_by, self._projection)
        self._image_ranges: dict[str, AdaptiveRange] = {}
        self._eye: Viewpoint | None = None
        self._field_of_view: list = []

    def begin(self, stream: rr.RecordingStream) -> None:
        """Log what is static, and the properties, to a stream that has a new file."""
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

    def end(self) -> None:
        """Give a recording without a point its blueprint."""
        if self._eye is None:
            self._choose_view(np.empty((0, 3)))

    def set_properties(self, name: str, facts: Mapping) -> None:
        """Set facts of one of the recording's properties, here and in all files that follow."""
        self._properties.setdefault(name, {}).update(facts)
        for stream in self._streams:
            schema.log_properties(stream, name, facts)

    def cloud(self, stamp_ns: int, frame_index: int, columns: Mapping[str, np.ndarray]) -> None:
        """Log a cloud; columns as for schema.points, in arrays that no longer change."""
        xyz = columns["xyz"]
        if len(xyz) and self._eye is None:
            self._choose_view(xyz)
        sample = xyz[:: max(len(xyz) // _RADIUS_SAMPLES, 1)]
        radius_m = point_radius_m(sample, self._sensor) if self._sensor else 0.0
        self.log(stamp_ns, frame_index, {schema.POINTS: schema.points(columns, self._colours(columns), radius_m)})

    def depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """Log a depth image, float32, in an array that no longer changes."""
        low, high = self._image_range(schema.DEPTH, depth_m)
        self.log(stamp_ns, frame_index, {schema.DEPTH: [schema.depth_image(depth_m, low, high)],
                                         schema.NO_DEPTH: [schema.no_depth(depth_m)]})

    def image(self, path: str, stamp_ns: int, frame_index: int, photons: np.ndarray) -> None:
        """Log one of schema.IMAGES: integers, or float32 with NaN = none, in an array that no longer changes."""
        low, high = self._image_range(path, photons)
        self.log(stamp_ns, frame_index, {path: [schema.photon_image(photons, low, high)]})

    def log(self, stamp_ns: int, frame_index: int | None, archetypes: Mapping[str, list]) -> None:
        """Log archetypes by entity path."""
        for stream in self._streams:
            stream.reset_time()
            stream.set_time(schema.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
            if frame_index is not None:
                stream.set_time(schema.FRAME, sequence=int(frame_index))
            for path, of_path in archetypes.items():
                stream.log(path, *of_path)

    def _image_range(self, path: str, image: np.ndarray) -> tuple[float, float]:
        return self._image_ranges.setdefault(path, AdaptiveRange()).update(image)

    def _choose_view(self, xyz: np.ndarray) -> None:
        self._eye = look_at(xyz, self._projection, fov_deg=_VIEWER_FOV_DEG, aspect=_VIEW_ASPECT)
        if self._sensor is not None:
            self._field_of_view = schema.field_of_view(self._sensor, xyz)
        for stream in self._streams:
            self._send_view(stream)

    def _send_view(self, stream: rr.RecordingStream) -> None:
        if self._field_of_view:
            stream.log(schema.SENSOR_PATH, *self._field_of_view, static=True)
        rerun_streams.send_blueprint(stream, self._blueprint(self._eye, self._sensor, self._images))


class _CloudColours:
    """Computes the colours of one cloud after the other; `projection` says which way is up."""

    def __init__(self, by: str, projection: Projection | None):
        table = {"range": range_table(), "intensity": visible_table(PHOTON_MAP)}
        self._by, self._tables = by, {name: packed(colours) for name, colours in table.items()}
        self._other = packed(visible_table(RANGE_MAP))
        self._up = sensor_axes(projection)[2].astype(np.float32)
        self._range = AdaptiveRange()

    def __call__(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """uint32 [N], 0xRRGGBBAA. By the intensity where the quantity to colour by is missing."""
        by = self._by if self._by in ("height", "range", *columns) else "intensity"
        if by == "height":
            values = columns["xyz"] @ self._up
        else:
            values = np.linalg.norm(columns["xyz"], axis=1) if by == "range" else columns[by]
        low, high = self._range.update(values)
        return self._tables.get(by, self._other)[levels(values, low, high, root=by == "intensity")]


def save_cloud(cloud: PointCloud, path: Path, sensor: SensorModel, properties: dict) -> None:
    """Write a cloud and its depth image to an .rrd file; OSError if it cannot be written."""
    stream = rr.RecordingStream(_CLOUD_APPLICATION_ID, recording_id=str(uuid.uuid4()))
    log = FrameLog([stream], sensor, {schema.RUN: properties}, (schema.DEPTH,), blueprint=still_blueprint)
    data = stream.binary_stream()       # not to the file: where that cannot be written, rerun waits for ever
    log.begin(stream)
    columns = {"xyz": cloud.xyz, "intensity": cloud.intensity, "row": cloud.row, "col": cloud.col,
               "surface": cloud.surface, "depth_std": cloud.depth_std_bins * sensor.bin_width_m}
    log.cloud(cloud.stamp_ns, 0, columns)
    log.depth(cloud.stamp_ns, 0, cloud.depth_image(sensor.projection))
    log.end()
    path.write_bytes(data.read())
    stream.disconnect()
    rerun_streams.free_ended()
