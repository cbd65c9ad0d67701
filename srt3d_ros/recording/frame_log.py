"""FrameLog: log clouds, images, scalars and log lines to a stream of rerun. Not thread-safe."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from srt3d_ros.colours import AdaptiveRange, levels, packed, range_table
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.pictures.viewpoint import look_at, point_radius_m
from srt3d_ros.recording import rerun_streams, schema
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles

_RADIUS_SAMPLES = 4096
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # of the viewer's 3D view, on a wide screen


class FrameLog:
    """Logs frames to a stream.

    Args:
        stream: to log to; `begin` has to be called when it has its file.
        sensor: sets the axes and the size of the points.
        properties: of the recording: {"run": {…}, …}.
        images: entity paths of the images that will be logged, for the blueprint.
    """

    def __init__(self, stream: rr.RecordingStream, sensor: SensorModel | None, properties: Mapping[str, Mapping],
                 images: tuple[str, ...]):
        self._stream, self._sensor, self._images = stream, sensor, images
        self._properties = {name: dict(facts) for name, facts in properties.items()}
        if sensor is not None:      # an IRF per pixel would take hundreds of megabytes
            self._properties[schema.SENSOR] = {"description": sensor_message.to_json(
                sensor.replace(irf=np.atleast_2d(sensor.irf).mean(axis=0, dtype=float)))}
        self._ranges: dict[str, AdaptiveRange] = {}         # of the colours, by entity path
        self._has_view = False

    def begin(self) -> None:
        """Log what is static, and the properties."""
        self._stream.log("/", schema.view_coordinates(self._sensor), static=True)
        self._stream.log(schema.NO_DEPTH, schema.no_depth_colour(), static=True)
        for path, style in plot_styles().items():
            self._stream.log(path, style, static=True)
        for name, facts in self._properties.items():
            schema.log_properties(self._stream, name, facts)

    def end(self) -> None:
        """Give a recording without a point its blueprint."""
        if not self._has_view:
            self._send_view(np.empty((0, 3)))

    def cloud(self, stamp_ns: int, frame_index: int, columns: Mapping[str, np.ndarray]) -> None:
        """Log a cloud, coloured by range; columns as for schema.points, in arrays that no longer change."""
        xyz = columns["xyz"]
        if len(xyz) and not self._has_view:
            self._send_view(xyz)
        sample = xyz[:: max(len(xyz) // _RADIUS_SAMPLES, 1)]
        radius_m = point_radius_m(sample, self._sensor) if self._sensor else 0.0
        range_m = np.linalg.norm(xyz, axis=1)
        colours = packed(range_table())[levels(range_m, *self._range(schema.POINTS, range_m))]
        self.log(stamp_ns, frame_index, {schema.POINTS: schema.points(columns, colours, radius_m)})

    def image(self, path: str, stamp_ns: int, frame_index: int, image: np.ndarray) -> None:
        """Log an image: integers, or float32 with NaN = none, in an array that no longer changes."""
        self.log(stamp_ns, frame_index, schema.image(path, image, *self._range(path, image)))

    def log(self, stamp_ns: int, frame_index: int | None, archetypes: Mapping[str, list]) -> None:
        """Log archetypes by entity path."""
        self._stream.reset_time()
        self._stream.set_time(schema.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
        if frame_index is not None:
            self._stream.set_time(schema.FRAME, sequence=int(frame_index))
        for path, of_path in archetypes.items():
            self._stream.log(path, *of_path)

    def _range(self, path: str, values: np.ndarray) -> tuple[float, float]:
        """The values at the ends of the colours."""
        return self._ranges.setdefault(path, AdaptiveRange()).update(values)

    def _send_view(self, xyz: np.ndarray) -> None:
        """Log the sensor's field of view and the blueprint, whose eye has the cloud in view."""
        self._has_view = True
        if self._sensor is not None:
            self._stream.log(schema.SENSOR_PATH, *schema.field_of_view(self._sensor, xyz), static=True)
        projection = self._sensor.projection if self._sensor else None
        eye = look_at(xyz, projection, fov_deg=_VIEWER_FOV_DEG, aspect=_VIEW_ASPECT)
        rerun_streams.send_blueprint(self._stream, film_blueprint(eye, self._sensor, self._images))
