"""recorder: clouds, images, photon counts and latencies → recordings (.rrd)."""

import os
import platform
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from rclpy.qos import ReliabilityPolicy
from rclpy.utilities import get_rmw_implementation_identifier

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.files.new_files import free
from srt3d_ros.messages import images_message, points_message, sensor_message, sketch_message
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.managed_node import ManagedNode
from srt3d_ros.nodes.common.parameters import Parameter, Values
from srt3d_ros.nodes.common.process import run
from srt3d_ros.nodes.common.topics import NodeSpec
from srt3d_ros.nodes.common.worker import Dropped
from srt3d_ros.nodes.motion_input import MOTION, MotionInput
from srt3d_ros.processes.versions import versions
from srt3d_ros.recording import entities
from srt3d_ros.recording.writer import IMAGES_HZ, FrameIndex, RecordedFrame, RecordingFailed, RecordingWriter

RECORDED_IMAGES = tuple(path.strip("/") for path in (entities.DEPTH_PATH, *entities.PHOTON_IMAGES))
ALL_IMAGES, NO_IMAGES = ",".join(RECORDED_IMAGES), "none"
WHICH_IMAGES = f"some of {ALL_IMAGES}, or {NO_IMAGES}"
PARAMETERS = (
    Parameter("path", "", "Path of the recording; if empty, recording_<UTC time>.rrd in the working directory. No file "
              "is replaced: where there is one, and for further recordings, NAME_2.rrd, NAME_3.rrd, ….",
              form="a path that ends with .rrd", inactive=True),
    Parameter("images", ALL_IMAGES, f"Images to record, of at most {IMAGES_HZ} frames a second.", form=WHICH_IMAGES),
)


def checked_path(text: str) -> Path:
    """The recording's absolute path, named after the time if `text` is empty; InvalidInput if it cannot be written."""
    path = Path(text or time.strftime("recording_%Y%m%dT%H%M%SZ.rrd", time.gmtime())).absolute()
    require(path.suffix == ".rrd", "path", text, "a path that ends with .rrd")
    require(path.parent.is_dir() and os.access(path.parent, os.W_OK), "path", text, "a file in a writable folder")
    return path


def checked_images(text: str) -> tuple[str, ...]:
    """The entities of the images that the parameter lists; InvalidInput if one does not exist."""
    names = [] if text == NO_IMAGES else [name.strip() for name in text.split(",")]
    for name in names:
        require(name in RECORDED_IMAGES, "images", text, WHICH_IMAGES)
    return tuple(f"/{name}" for name in RECORDED_IMAGES if name in names)


QUEUE = 128             # messages that wait for the disk
POSE_NS = 10**9         # clouds wait for their pose this long, by their stamps

SPEC = NodeSpec(
    "recorder",
    inputs=(topics.SKETCH_SENSOR, topics.POINTS, topics.FREE, *topics.IMAGE_TOPICS, topics.SKETCH, topics.ODOM),
    parameters=PARAMETERS,
)


class RecorderNode(ManagedNode):
    """Writes a recording while it is active, beginning with the first description on `sketch/sensor`."""

    spec = SPEC
    drain_s = 15.0          # queued messages are still written
    finish_s = 45.0         # drain_s and the 30 s after which the writer gives up a disk; `srt3d up` waits for 60 s
    niceness = 10           # gets a tenth of another node's share of a busy core
    reliability = ReliabilityPolicy.BEST_EFFORT     # publishers never wait for it; it counts the messages it misses

    def __init__(self):
        super().__init__(QUEUE)
        self._writer: RecordingWriter | None = None
        self._path: Path | None = None      # of the recording that is open or begins next
        self._unplaced: deque[tuple[RecordedFrame, np.ndarray, np.ndarray]] = deque()      # with xyz and intensity

    def configure(self) -> None:
        """Check the parameters and collect the properties of every recording."""
        checked_path(self.parameters["path"])
        self._images = checked_images(self.parameters["images"])
        self._versions = versions() | {"rmw": get_rmw_implementation_identifier()}

    def check(self, values: Values) -> None:
        require(self.state != "active", "path", problem="path can be set while the recorder is inactive: "
                f"ros2 lifecycle set {self.get_fully_qualified_name()} deactivate")
        checked_path(values["path"])

    # ---- Recordings

    def activate(self) -> None:
        self._asked = checked_path(self.parameters["path"])
        self._path = free(self._asked)
        self._sensor: SensorModel | None = None
        self._frames = FrameIndex()
        self.hold_frames_for("the sketch's description", topics.SKETCH_SENSOR)
        self.exit_code = 0
        self.diagnostics.count(clouds=0, images_skipped=0)
        self._motion = MotionInput(self, self._on_motion)
        # Publishers discover these readers in this order: images before points, and the description last.
        for topic in topics.IMAGE_TOPICS:
            if f"/{topic.name}" in self._images:
                self._record(topic, images_message.decode_cdr, partial(self._log_image, f"/{topic.name}"))
        self._record(topics.FREE, points_message.decode_ends_cdr, self._log_free)
        # Subscribe before `points`, so that a backlog of sketches is read first.
        self._record(topics.SKETCH, sketch_message.decode_counts_cdr, self._log_sketch)
        self._record(topics.POINTS, points_message.decode_cdr, self._log_points)
        self.follow(topics.SKETCH_SENSOR, self._on_sensor)
        self.diagnostics.show(path=self._path)

    def forget(self) -> None:
        self._path = None
        self.diagnostics.show(path="")
        if self._writer is not None:
            self._end_recording(self._writer)

    def _end_recording(self, writer: RecordingWriter) -> None:
        self._place(writer, at_once=True)
        self._writer = None
        writer.close()

    def _on_sensor(self, raw: bytes) -> None:
        sensor, before = sensor_message.decode_cdr(raw), self._sensor
        Pose.from_text(sensor.extrinsics or "")     # refuses the description, in place of each of its clouds
        if self._path is None:
            return
        if self._writer is not None and before and sensor.replace(mask=None).same_as(before.replace(mask=None)):
            if not sensor.same_as(before):      # the first second has shown hot pixels
                self._sensor = sensor
                self._writer.describe(sensor)
            return
        if self._writer is not None:        # another sensor needs another recording
            self._end_recording(self._writer)
            if self.stopping.is_set():      # a node that stops begins no recording; the remaining frames are dropped
                self._path = None
                return
            self._path = free(self._asked)
        self._sensor, self._frequencies, self.diagnostics.frame_id = sensor, (), sensor.frame_id
        self.diagnostics.degrade(MOTION, "")        # of another sensor
        self.get_logger().info(f"recording to {self._path}")
        about_run = {"namespace": self.get_namespace(), "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                     "machine": platform.node(), "cpus": os.cpu_count()}
        self._writer = RecordingWriter(self._path, sensor, {entities.RUN: about_run, entities.VERSIONS: self._versions},
                                       images=self._images)
        self.release_frames()

    def failed(self, error: Exception, frames: int = 0) -> None:
        """End a recording that failed; the node stays active, reads nothing, and is ERROR until activated again."""
        if not isinstance(error, RecordingFailed):
            return super().failed(error, frames)
        self.get_logger().error(str(error))
        self.diagnostics.error(str(error))
        self.diagnostics.drop("not_recording", frames)
        self._writer = None
        self._unplaced.clear()
        self.unsubscribe()
        self.release_frames()
        self.forget()
        self.diagnostics.problem = f"not recording: {error.why}"
        self.exit_code = 1

    # ---- Frames

    def _record(self, topic: topics.Topic, decode: Callable[[bytes], tuple], log: Callable[..., None]) -> None:
        """Call `log` in the worker with the open recording, the frame and what `decode` gives behind the header."""
        def handle(raw: bytes) -> None:
            header, *content = decode(raw)
            writer = self._writer
            if writer is None:
                raise Dropped("not_recording", "no recording is open")
            frame = self._frames[header.stamp_ns]
            log(writer, frame, *content)
            self.sent(frame.stamp_ns)
            self.diagnostics.show(path=writer.path)

        self.subscribe(topic, handle)

    def _log_points(self, writer: RecordingWriter, frame: RecordedFrame, columns: dict[str, np.ndarray]) -> None:
        number_of_points = len(columns["xyz"])
        sketch_ns = frame.sketch_ns
        series = {"latency_ms": (self.received_ns - frame.stamp_ns) * 1e-6, "points": number_of_points,
                  "latency_reconstruct_ms": None if sketch_ns is None else (self.received_ns - sketch_ns) * 1e-6,
                  "frame_rate_hz": self._frames.cloud_came(frame)}
        writer.log_scalars(frame.stamp_ns, series, frame.number)
        recorded = {name: columns[name] for name in ("xyz", "intensity", *entities.OF_FULL_CLOUDS) if name in columns}
        writer.log_cloud(frame.stamp_ns, frame.number, **recorded)
        self.diagnostics.count(clouds=1, points=number_of_points)
        self._unplaced.append((frame, columns["xyz"], columns["intensity"]))
        self._place(writer)

    def _on_motion(self) -> None:
        """Have the worker place clouds if some wait; called in the executor's thread."""
        if self._unplaced:
            self.worker.call(lambda: self._writer and self._place(self._writer))

    def _place(self, writer: RecordingWriter, at_once: bool = False) -> None:
        """Log the poses of clouds that odometry has reached by now; give up those that have waited for POSE_NS."""
        mount = self._sensor.extrinsics if self._sensor else None
        if mount is None:               # the sensor does not move
            return self._unplaced.clear()
        while self._unplaced:
            frame, xyz, intensity = self._unplaced[0]
            late = at_once or not 0 <= self._unplaced[-1][0].stamp_ns - frame.stamp_ns < POSE_NS
            trajectory, reason = self._motion.over(mount, frame.stamp_ns, frame.stamp_ns, late)
            if trajectory is None and not reason:
                return
            self._unplaced.popleft()
            if trajectory is None and self._motion.track.trajectory.newest_ns is None:
                continue                # the robot has no odometry
            problem = reason and f"clouds are recorded without a pose: {reason}"
            if trajectory is None:
                self.diagnostics.count(clouds_unplaced=1)
            else:
                pose = trajectory.at(frame.stamp_ns)
                writer.log_pose(frame.stamp_ns, frame.number, pose)
                if frame.has_images:
                    writer.log_room(frame.stamp_ns, frame.number, pose, xyz, intensity)
                self.diagnostics.count(clouds_placed=1)
            self._motion.judge(problem, "clouds have poses again")

    def _log_free(self, writer: RecordingWriter, frame: RecordedFrame, ends: np.ndarray) -> None:
        writer.log_free(frame.stamp_ns, frame.number, ends)

    def _log_image(self, path: str, writer: RecordingWriter, frame: RecordedFrame, image: np.ndarray) -> None:
        if frame.has_images:
            writer.log_image(path, frame.stamp_ns, frame.number, image)
        else:
            self.diagnostics.count(images_skipped=1)

    def _log_sketch(self, writer: RecordingWriter, frame: RecordedFrame, frequencies: tuple[int, ...],
                    counts: np.ndarray) -> None:
        photons = int(counts.sum(dtype=np.int64))
        if frequencies != self._frequencies:
            self._frequencies = frequencies
            writer.set_properties(entities.RUN, {"frequencies": list(frequencies)})
        frame.sketch_ns = self.received_ns
        series = {"latency_sketch_ms": (self.received_ns - frame.stamp_ns) * 1e-6, "photons": photons,
                  "ppp": photons / max(counts.size, 1)}
        writer.log_scalars(frame.stamp_ns, series, frame.number)
        if entities.PHOTONS_PATH in self._images:
            self._log_image(entities.PHOTONS_PATH, writer, frame, counts)
        self.diagnostics.count(photons=photons)


main = partial(run, RecorderNode)
