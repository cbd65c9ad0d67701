"""FrameLog: what is written to a recording for each frame. One thread; the queue before it is writer.py's."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.colours import CLOUD_MAP, AdaptiveRange, intensity_levels, packed_colour_table
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import layout
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles
from srt3d_ros.recording.file_sink import FileSink
from srt3d_ros.viewpoint import Viewpoint, look_at, point_radius_m

_FLUSH_TIMEOUT_S = 2.0
_FLUSH_TRIES = 10
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # of the viewer's 3D view, on a wide screen


class FrameLog:
    """An .rrd file being written, with its blueprint, properties and colour ranges.

    Args:
        path: the file; an existing one is overwritten.
        sensor, application_id, properties: as for RecordingWriter.
        blueprint: makes the layout it opens with, for the eye given to it.

    Raises:
        OSError: if the file cannot be opened, or from any method once it cannot be written.
    """

    def __init__(self, path: Path, sensor: SensorModel | None, application_id: str, properties: dict,
                 blueprint: Callable[[Viewpoint], rrb.Blueprint] = film_blueprint):
        self._sensor, self._blueprint = sensor, blueprint
        self._sink = FileSink(path)
        self._stream = rr.RecordingStream(application_id)
        self._stream.save(self._sink.pipe_path)
        self._sink.opened()
        self._eye_chosen, self._in_mm = False, layout.fits_mm(sensor)
        self._intensity_range, self._depth_range = AdaptiveRange(), AdaptiveRange()
        self._write_statics(properties)

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._sink.bytes_written

    def cloud(self, stamp_ns: int, frame_index: int, xyz: np.ndarray, intensity: np.ndarray) -> None:
        """Write a cloud; float32 arrays that nobody changes any more."""
        if len(xyz) and not self._eye_chosen:
            self._choose_eye(xyz)
        level = intensity_levels(intensity, *self._intensity_range.update(intensity))
        colour = packed_colour_table(CLOUD_MAP)[level]
        self._at(stamp_ns, frame_index)
        radius_m = point_radius_m(xyz, self._sensor) if self._sensor else 0.0
        self._stream.log(layout.POINTS, *layout.points(xyz, intensity, colour, radius_m))
        self._check()

    def depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """Write a depth image; a float32 array that nobody changes any more."""
        self._at(stamp_ns, frame_index)
        low, high = self._depth_range.update(depth_m)
        self._stream.log(layout.DEPTH, layout.depth_image(depth_m, low, high, self._in_mm))
        self._check()

    def scalars(self, stamp_ns: int, frame_index: int | None, values: dict[str, float]) -> None:
        """Write one value for each of several series; None = none this time."""
        self._at(stamp_ns, frame_index)
        for name in (name for name, value in values.items() if value is not None):
            self._stream.log(layout.metric_path(name), rr.Scalars(float(values[name])))
        self._check()

    def flush(self) -> None:
        """Return when all written so far is in the file; OSError if the disk takes nothing for 20 s."""
        for _ in range(_FLUSH_TRIES):
            self._check()
            try:
                return self._stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            except RuntimeError:        # the time is over: a slow disk
                continue
        raise OSError(f"the disk took nothing for {_FLUSH_TRIES * _FLUSH_TIMEOUT_S:g} s")

    def close(self) -> None:
        """Write the footer and close the file."""
        if not self._eye_chosen:
            self._choose_eye(np.empty((0, 3)))
        self.flush()
        self._stream.disconnect()
        self._sink.wait()
        self._check()

    def _at(self, stamp_ns: int, frame_index: int | None) -> None:
        self._stream.reset_time()
        self._stream.set_time(layout.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
        if frame_index is not None:
            self._stream.set_time(layout.FRAME, sequence=int(frame_index))

    def _choose_eye(self, xyz: np.ndarray) -> None:
        projection = self._sensor.projection if self._sensor else None
        eye = look_at(xyz, projection, fov_deg=_VIEWER_FOV_DEG, aspect=_VIEW_ASPECT)
        self._stream.send_blueprint(self._blueprint(eye))
        self._eye_chosen = True

    def _write_statics(self, properties: dict) -> None:
        self._stream.log("/", layout.view_coordinates(self._sensor), static=True)
        for path, style in plot_styles().items():
            self._stream.log(path, style, static=True)
        if properties:
            self._stream.send_property(layout.RUN, layout.property_values(properties))
        if self._sensor is not None:
            self._stream.send_property(layout.SENSOR, layout.property_values(layout.sensor_properties(self._sensor)))

    def _check(self) -> None:
        if self._sink.error is not None:
            raise OSError(self._sink.error)
