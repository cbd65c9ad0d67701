"""Record clouds, images and scalars in an .rrd file."""

import atexit
import math
import shutil
import threading
import time
import uuid
from collections import defaultdict, deque
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import numpy as np
import rerun as rr

from srt3d_ros import compat
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import sensor_message
from srt3d_ros.pictures.colours import GREY_TABLE, RANGE_TABLE, AdaptiveRange, levels, packed, shaded
from srt3d_ros.pictures.viewpoint import LEVEL, look_at, point_radius_m
from srt3d_ros.processes.children import end_at_once
from srt3d_ros.recording import entities
from srt3d_ros.recording.blueprint import film_blueprint, plot_styles

# A flush writes a chunk of each entity, and rerun keeps 3 kB of index per chunk in memory until the file is finished:
# few flushes. Without any, large clouds keep rerun from writing scalars.
FLUSH_PERIOD_S = 1.0
BATCHING = rr.ChunkBatcherConfig(flush_tick=timedelta(seconds=5 * FLUSH_PERIOD_S))
FLUSH_TIMEOUT_S = 20.0      # a slower disk counts as hanging
END_TIMEOUT_S = 10.0        # for the footer, after all else is written
LEAST_FREE_BYTES = 500_000_000      # stop recording below this: the footer and other programs need room
_TYPES = {"row": np.uint16, "col": np.uint16, "surface": np.uint8}      # other columns are float32
STAMPS_KEPT = 256           # of frames whose numbers are known
_RATE_CLOUDS = 10           # whose stamps give the rate and the playing speed; the view waits for them, or for the end
_USUAL_RATE_HZ = 10.0       # if stamps do not grow
_VIEWER_FOV_DEG, _VIEW_ASPECT = 55, 1.2     # the viewer's 3D view on a wide screen
_ROOM_YAW_DEG, _ROOM_PITCH_DEG = 30, 40     # of the eye on a room
_FRUSTUM_SHARE = 0.15       # of the clouds' range, so that a sensor in a room is seen
IMAGES_HZ = 5       # at most; the viewer's limit of memory does not count images (rerun issues 12591, 12688)
_IMAGES_NS, _JITTER_NS = 10**9 // IMAGES_HZ, 10**9 // IMAGES_HZ // 4
_ROOM_POINTS = 10_000       # of a cloud; 10 s of clouds are half a million
_SAMPLES, _SAMPLED_CLOUDS = 200, 1000       # points of each, of rooms that the view is to show


@dataclass
class RecordedFrame:
    """A frame, numbered in the order in which stamps were first seen; `sketch_ns` is when its sketch arrived.

    Its images are recorded if `has_images`, at most IMAGES_HZ times a second of stamps.
    """

    stamp_ns: int
    number: int
    has_images: bool = True
    sketch_ns: int | None = None


class FrameIndex:
    """The newest STAMPS_KEPT frames, and the rate of clouds."""

    def __init__(self):
        self._frames: dict[int, RecordedFrame] = {}
        self._seen = 0
        self._clouds: deque[int] = deque(maxlen=_RATE_CLOUDS)
        self._images_due_ns = 0

    def __getitem__(self, stamp_ns: int) -> RecordedFrame:
        """The frame with this stamp, added if new."""
        frame = self._frames.get(stamp_ns)
        if frame is None:
            frame = self._frames[stamp_ns] = RecordedFrame(stamp_ns, self._seen, self._has_images(stamp_ns))
            self._seen += 1
            if len(self._frames) > STAMPS_KEPT:
                del self._frames[next(iter(self._frames))]
        return frame

    def _has_images(self, stamp_ns: int) -> bool:
        early_ns = self._images_due_ns - stamp_ns
        if _JITTER_NS < early_ns < 5 * _IMAGES_NS:      # earlier still: stamps fell back
            return False
        self._images_due_ns = (self._images_due_ns if abs(early_ns) <= _JITTER_NS else stamp_ns) + _IMAGES_NS
        return True

    def cloud_came(self, frame: RecordedFrame) -> float | None:
        """Count a frame's cloud; clouds per second by their stamps, None for the first."""
        self._clouds.append(frame.stamp_ns)
        seconds = (self._clouds[-1] - self._clouds[0]) * 1e-9
        return (len(self._clouds) - 1) / seconds if seconds > 0 else None


class RecordingFailed(Exception):
    """The file cannot be written any more, or the disk is nearly full; `why` says so without the path."""

    def __init__(self, path: Path, error: Exception):
        self.why = " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())
        super().__init__(f"recording {path}: {self.why}")


class RecordingWriter(AbstractContextManager):
    """Writes an .rrd file with the timelines `stamp` and `frame`. Not thread-safe. Copies arrays.

    rerun writes in its own threads; every second, a log_… method waits for them.

    Args:
        path: the .rrd file, which must not exist.
        sensor: sets the axes and the size of the points.
        properties: of the recording, {"run": {…}, …}: numbers, strings, lists of them.
        images: entity paths of the images to show in the blueprint.

    Raises:
        RecordingFailed: the file cannot be written, or the disk has less than 500 MB left. Methods raise it, too; then
            the file is finished if possible, and the writer cannot be used again.
    """

    def __init__(self, path: str | Path, sensor: SensorModel, properties: Mapping[str, Mapping] | None = None, *,
                 images: tuple[str, ...] = (entities.DEPTH_PATH,)):
        self.path, self._sensor, self._images = Path(path), sensor, images
        self._ranges: dict[str, AdaptiveRange] = defaultdict(AdaptiveRange)        # of colours, by entity path or name
        self._stamps_ns: deque[int] = deque(maxlen=_RATE_CLOUDS)
        self._framed = np.empty((0, 3), np.float32)         # points that the view is to show
        self._has_view = False
        self._pose: Pose | None = None                      # the last one logged
        self._room: list[np.ndarray] = []                   # samples of clouds in the fixed frame
        self._open = True
        try:
            self._check_disk()
            compat.create_rerun_file(self.path)
        except OSError as error:
            raise RecordingFailed(self.path, error) from None
        self._stream = rr.RecordingStream(entities.APPLICATION_ID, recording_id=str(uuid.uuid4()),
                                          batcher_config=BATCHING)
        self._stream.save(self.path)
        # Runs before rerun's exit handler, which in rerun 0.41 can deadlock with a thread that still logs.
        atexit.register(self.close)
        self._flushed_s = time.monotonic()
        self._log_static(properties or {})

    def log_cloud(self, stamp_ns: int, frame_index: int, xyz: np.ndarray, intensity: np.ndarray,
                  **more: np.ndarray) -> None:
        """Log a cloud: `xyz` [N, 3] in metres, `intensity` [N] in photons; `more`: entities.OF_FULL_CLOUDS."""
        # Copies, because rerun reads the arrays later.
        columns = {name: np.array(values, _TYPES.get(name, np.float32), order="C")
                   for name, values in {"xyz": xyz, "intensity": intensity, **more}.items()}
        xyz = columns["xyz"]
        if not self._has_view:
            self._stamps_ns.append(stamp_ns)
            self._framed = xyz if len(xyz) else self._framed
            if len(self._framed) and len(self._stamps_ns) == _RATE_CLOUDS:
                self._send_view()
        colours = shaded(RANGE_TABLE[self._levels("range", np.linalg.norm(xyz, axis=1))],
                         self._levels("intensity", columns["intensity"], root=True))
        archetypes = entities.points(columns, packed(colours), point_radius_m(xyz, self._sensor))
        self._log(stamp_ns, frame_index, {entities.POINTS_PATH: archetypes})

    def log_free(self, stamp_ns: int, frame_index: int, ends: np.ndarray) -> None:
        """Log how far it is empty: the ends of rays without a point, float32 [N, 3], metres."""
        self._log(stamp_ns, frame_index, {entities.FREE_PATH: entities.fan(ends)})

    def log_pose(self, stamp_ns: int, frame_index: int, pose: Pose) -> None:
        """Log the sensor's pose in a fixed frame with z up, in which the 3D view stands from the first pose on."""
        if self._pose is None:
            self._stream.log("/", rr.ViewCoordinates.FLU, static=True)
            for path in (entities.POINTS_PATH, entities.FREE_PATH):
                self._stream.log(path, rr.CoordinateFrame(f"tf#{entities.POSE_PATH}"), static=True)
        self._log(stamp_ns, frame_index, entities.pose(pose, self._pose or pose))
        self._pose = pose

    def log_room(self, stamp_ns: int, frame_index: int, pose: Pose, xyz: np.ndarray, intensity: np.ndarray) -> None:
        """Log some points of a cloud in the fixed frame, to be shown for some seconds, grey as in a photograph."""
        step = max(math.ceil(len(xyz) / _ROOM_POINTS), 1)
        xyz, intensity = xyz[frame_index % step::step], intensity[frame_index % step::step]
        fixed = pose(xyz).astype(np.float32)
        grey = packed(GREY_TABLE)[self._levels("brightness", intensity * (xyz**2).sum(axis=1), root=True)]
        radius = point_radius_m(xyz, self._sensor) or None
        self._log(stamp_ns, frame_index, {entities.ROOM_PATH: [rr.Points3D(fixed, colors=grey, radii=radius)]})
        self._room.append(fixed[::max(len(fixed) // _SAMPLES, 1)])
        if len(self._room) > _SAMPLED_CLOUDS:
            del self._room[::2]

    def log_image(self, path: str, stamp_ns: int, frame_index: int, image: np.ndarray) -> None:
        """Log an image [rows, cols], NaN = none: entities.DEPTH_PATH in metres, entities.PHOTON_IMAGES in photons."""
        whole = np.asarray(image).dtype.kind in "iu"
        image = np.array(image, np.uint32 if whole else np.float32, order="C")
        self._log(stamp_ns, frame_index, entities.image(path, image, *self._ranges[path].update(image)))

    def log_scalars(self, stamp_ns: int, values: Mapping[str, float], frame_index: int) -> None:
        """Log a value of each time series: {"latency_ms": 35.1, "points": 19_871}; None is skipped."""
        self._log(stamp_ns, frame_index, {entities.metric_path(name): [rr.Scalars(float(value))]
                                          for name, value in values.items() if value is not None})

    def describe(self, sensor: SensorModel) -> None:
        """Set the sensor's description; again if its mask changes."""
        # An IRF per pixel would take hundreds of megabytes.
        description = sensor_message.to_json(sensor.replace(irf=sensor.mean_irf))
        self.set_properties(entities.SENSOR_PROPERTY, {"description": description})

    def set_properties(self, name: str, facts: Mapping) -> None:
        """Set facts of a property of the recording."""
        entities.log_properties(self._stream, name, facts)

    def flush(self) -> None:
        """Wait until the file has everything that was logged."""
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
            if not self.path.exists():
                raise OSError("stopped, as the file is gone")
            self._check_disk()
        except (OSError, RuntimeError, ValueError) as error:        # from the disk or rerun
            self._finish()
            raise RecordingFailed(self.path, error) from None
        self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Finish the file. Idempotent. The process exits with 1 if the disk hangs, because rerun has no timeout."""
        if self._open:
            if not self._has_view or self._pose is not None:        # of a room, once all of it was seen
                self._send_view()
            self.flush()
            self._finish()

    def __exit__(self, *_) -> None:
        self.close()

    def _log(self, stamp_ns: int, frame_index: int, archetypes: Mapping[str, list]) -> None:
        """Log archetypes, given by entity path."""
        self._stream.reset_time()
        self._stream.set_time(entities.STAMP, timestamp=np.datetime64(int(stamp_ns), "ns"))
        self._stream.set_time(entities.FRAME_INDEX, sequence=int(frame_index))
        for path, of_path in archetypes.items():
            self._stream.log(path, *of_path)
        if time.monotonic() - self._flushed_s > FLUSH_PERIOD_S:
            self.flush()

    def _levels(self, name: str, values: np.ndarray, root: bool = False) -> np.ndarray:
        """Levels of a colour map between ends that follow the data."""
        return levels(values, self._ranges[name].update(values), root)

    def _log_static(self, properties: Mapping[str, Mapping]) -> None:
        """Log what is the same for all frames."""
        self._stream.log("/", entities.view_coordinates(self._sensor), static=True)
        self._stream.log(entities.NO_DEPTH, entities.no_depth_colour(), static=True)
        for path, style in plot_styles().items():
            self._stream.log(path, style, static=True)
        for name, facts in properties.items():
            self.set_properties(name, facts)
        self.describe(self._sensor)

    def _send_view(self) -> None:
        """Log the sensor's field of view and the blueprint with an eye on the newest cloud with points, or the room."""
        self._has_view, moving = True, self._pose is not None
        path, share = (entities.MOVING_SENSOR_PATH, _FRUSTUM_SHARE) if moving else (entities.SENSOR_PATH, 1)
        self._stream.log(path, entities.field_of_view(self._sensor, share * self._framed), static=True)
        options = {"fov_deg": _VIEWER_FOV_DEG, "aspect": _VIEW_ASPECT}
        if moving and self._room:
            eye = look_at(np.concatenate(self._room), None, _ROOM_YAW_DEG, _ROOM_PITCH_DEG, axes=LEVEL, **options)
        else:
            eye = look_at(self._framed, self._sensor.projection, **options)
        blueprint = film_blueprint(eye, self._sensor, self._images, self._rate_hz(), moving)
        compat.send_rerun_blueprint(self._stream, blueprint)

    def _rate_hz(self) -> float:
        """Clouds per second of sensor time, whatever frames were lost."""
        step_ns = float(np.median(np.diff(self._stamps_ns))) if len(self._stamps_ns) > 1 else 0.0
        return 1e9 / step_ns if step_ns > 0 else _USUAL_RATE_HZ

    def _check_disk(self) -> None:
        left = shutil.disk_usage(self.path.parent).free
        if left < LEAST_FREE_BYTES:
            raise OSError(f"stopped, as the disk has only {left / 1e6:.0f} MB left")

    def _finish(self) -> None:
        """Make rerun write the footer and end its threads."""
        atexit.unregister(self.close)
        ending = threading.Thread(target=self._stream.disconnect, daemon=True)
        self._open = False
        del self._stream        # so that it can be freed
        ending.start()
        ending.join(END_TIMEOUT_S)
        if ending.is_alive():
            atexit.register(end_at_once, 1)     # called before rerun's handler: last registered, first called
        else:
            compat.free_rerun_streams()
