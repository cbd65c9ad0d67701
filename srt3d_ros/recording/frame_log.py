"""FrameLog: what is written for each frame, to whatever listens: a file, then the next file, a viewer. One thread."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.colours import AdaptiveRange
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import layout
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles
from srt3d_ros.recording.colouring import CloudColours, Colouring
from srt3d_ros.recording.compact import by_intensity
from srt3d_ros.recording.streams import send_blueprint
from srt3d_ros.viewpoint import Viewpoint, look_at, point_radius_m

_RADIUS_SAMPLES = 4096
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # of the viewer's 3D view, on a wide screen


@dataclass(frozen=True)
class Style:
    """How clouds and images are recorded.

    Args:
        colouring: of the points.
        exact: points in their order, values in float32; otherwise a third of the size is saved, see compact.py.
        blueprint: makes the layout that the recording opens with, from the eye, the sensor and the names of the images.
    """

    colouring: Colouring = field(default_factory=Colouring)
    exact: bool = False
    blueprint: Callable[..., rrb.Blueprint] = film_blueprint


class FrameLog:
    """Logs frames to every stream in `streams`, all of which begin with `begin`.

    Args:
        sensor: sets the axes, the size of the points and the precision of the depth image.
        properties: what is told of the recording: {"run": {…}, …}.
        images: names of the images that will come, for the layout.
        style: how.
    """

    def __init__(self, sensor: SensorModel | None, properties: Mapping[str, Mapping], images: tuple[str, ...],
                 style: Style):
        self.streams: list[rr.RecordingStream] = []
        self._sensor, self._style, self._images = sensor, style, images
        self._properties = {name: dict(facts) for name, facts in properties.items()}
        self._projection = sensor.projection if sensor else None
        self._colours = CloudColours(style.colouring, self._projection)
        self._depth_range, self._in_mm = AdaptiveRange(), layout.fits_mm(sensor) and not style.exact
        self._image_ranges: dict[str, AdaptiveRange] = {}
        self._eye: Viewpoint | None = None
        self._view: list = []

    def begin(self, stream: rr.RecordingStream) -> None:
        """Log to this stream from now on, first what every recording begins with."""
        stream.log("/", layout.view_coordinates(self._sensor), static=True)
        for path, style in plot_styles().items():
            stream.log(path, style, static=True)
        for name, facts in self._properties.items():
            layout.tell(stream, name, facts)
        if self._sensor is not None:
            layout.tell(stream, layout.SENSOR, layout.sensor_properties(self._sensor))
        if self._eye is not None:
            self._send_look(stream)
        self.streams.append(stream)

    def end(self, stream: rr.RecordingStream) -> None:
        """Log no more to this stream; a recording without a point gets its layout now."""
        self.streams.remove(stream)
        if self._eye is None:
            self._choose_look(np.empty((0, 3)))
            self._send_look(stream)
            self._eye = None

    def tell(self, name: str, facts: Mapping) -> None:
        """Set facts of one of the recording's properties, here and in all files that follow."""
        self._properties.setdefault(name, {}).update(facts)
        for stream in self.streams:
            layout.tell(stream, name, facts)

    def cloud(self, stamp_ns: int, frame_index: int, columns: Mapping[str, np.ndarray]) -> None:
        """Log a cloud; columns as for layout.points, in arrays that nobody changes any more."""
        if not self.streams:        # nobody listens: spare the sorting
            return
        xyz = columns["xyz"]
        if len(xyz) and self._eye is None:
            self._choose_look(xyz)
            for stream in self.streams:
                self._send_look(stream)
        if not self._style.exact:
            columns = by_intensity(columns)
        some = xyz[:: max(len(xyz) // _RADIUS_SAMPLES, 1)]
        radius_m = point_radius_m(some, self._sensor) if self._sensor else 0.0
        things = layout.points(columns, self._colours(columns), radius_m, self._style.exact)
        self._log(stamp_ns, frame_index, {layout.POINTS: things})

    def depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """Log a depth image; a float32 array that nobody changes any more."""
        low, high = self._depth_range.update(depth_m)
        self._log(stamp_ns, frame_index, {layout.DEPTH: [layout.depth_image(depth_m, low, high, self._in_mm)]})

    def image(self, path: str, stamp_ns: int, frame_index: int, photons: np.ndarray) -> None:
        """Log one of layout.IMAGES: integers, or float32 with NaN = none; an array that nobody changes any more."""
        low, high = self._image_ranges.setdefault(path, AdaptiveRange()).update(photons)
        self._log(stamp_ns, frame_index, {path: [layout.photon_image(photons, low, high, self._style.exact)]})

    def scalars(self, stamp_ns: int, frame_index: int | None, values: Mapping[str, float]) -> None:
        """Log one value for each of several series; None = none this time."""
        self._log(stamp_ns, frame_index, {layout.metric_path(name): [rr.Scalars(float(value))]
                                          for name, value in values.items() if value is not None})

    def line(self, stamp_ns: int, frame_index: int | None, text: str, level: int) -> None:
        """Log a line of a node's log; the level as in rcl_interfaces/Log."""
        self._log(stamp_ns, frame_index, {layout.LOG: [layout.log_line(text, level)]})

    def _log(self, stamp_ns: int, frame_index: int | None, things: Mapping[str, list]) -> None:
        for stream in self.streams:
            stream.reset_time()
            stream.set_time(layout.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
            if frame_index is not None:
                stream.set_time(layout.FRAME, sequence=int(frame_index))
            for path, archetypes in things.items():
                stream.log(path, *archetypes)

    def _choose_look(self, xyz: np.ndarray) -> None:
        self._eye = look_at(xyz, self._projection, fov_deg=_VIEWER_FOV_DEG, aspect=_VIEW_ASPECT)
        if self._sensor is not None:
            self._view = layout.view_of(self._sensor, xyz)

    def _send_look(self, stream: rr.RecordingStream) -> None:
        if self._view:
            stream.log(layout.SENSOR_PATH, *self._view, static=True)
        send_blueprint(stream, self._style.blueprint(self._eye, self._sensor, self._images))
