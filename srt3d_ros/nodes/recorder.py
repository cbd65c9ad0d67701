"""recorder: `points`, `depth`, photon counts and the pipeline's health → a recording (.rrd)."""

import os
import sys
import time
from itertools import count
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from srt3d_ros import __version__
from srt3d_ros.errors import require
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.interface import Interface, Service
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.worker import Dropped
from srt3d_ros.recording.writer import RecordingWriter

QUEUE = 64              # messages that may wait; the writer has its own, shorter queue of clouds and images
WRITER_QUEUE, LOSSLESS_WRITER_QUEUE = 8, 256
STAMPS_KEPT = 256

PARAMETERS = (
    Parameter("path", "", "The recording; recording_<UTC time>.rrd in the working directory if empty. The first "
              "replaces a file that exists; those that `~/start_recording` begins after it are numbered.",
              form="a path that ends with .rrd"),
    Parameter("record", True, "Record as soon as the node is active; if false, from `~/start_recording` on."),
    Parameter("lossless", False, "Queue more before dropping: for replays faster than a sensor."),
)

INTERFACE = Interface(
    "recorder",
    purpose="Logs the live clouds, depth images, photon counts and the pipeline's health with rerun into a file, "
    "without a screen. A recording begins when the sensor's description has come.",
    inputs=(topics.SKETCH_SENSOR, topics.POINTS, topics.IMAGES[0], topics.SKETCH, topics.DIAGNOSTICS),
    services=(Service("start_recording", "begin a new recording"), Service("stop_recording", "finish the recording")),
    parameters=PARAMETERS,
    limits=("Where the disk cannot follow, the oldest waiting clouds and images are dropped and counted in "
            "`recording_dropped`; scalars are kept.",),
)


class RecorderNode(PipelineNode):
    """Subscribes while it records; a recording starts when the first `sketch/sensor` has come."""

    interface = INTERFACE
    drains = True           # what has arrived is written
    finish_s = 35.0         # longer than a writer takes to give up

    def __init__(self):
        super().__init__(QUEUE)
        self._writer: RecordingWriter | None = None
        self._path: Path | None = None      # of the recording under way
        self._recordings = 0

    def configure(self) -> None:
        """Check the path."""
        _checked_path(self.parameters["path"])
        self.serve("start_recording", self._start)
        self.serve("stop_recording", self._stop)

    def activate(self) -> None:
        """Record, unless that waits for the service."""
        if self.parameters["record"]:
            self._start()

    def _start(self) -> str:
        require(self._path is None, "recording", self._path, "none under way: call ~/stop_recording first")
        self._path = _numbered(_checked_path(self.parameters["path"]), self._recordings)
        self._recordings += 1
        self._frequencies: tuple[int, ...] = ()
        self._indices: dict[int, int] = {}
        self._frames_seen = 0
        self._drops = Drops()
        self.hold_frames_for("the sketch's description on sketch/sensor")
        self.follow("sketch/sensor", self._on_sensor)
        self.subscribe("points", self._on_points)
        self.subscribe("depth", self._on_depth)
        self.subscribe("sketch", self._on_sketch)
        self.follow("/diagnostics", self._on_diagnostics)
        self.diagnostics.show(path=self._path)
        return f"recording to {self._path}"

    def _stop(self) -> str:
        require(self._path is not None, "recording", "none", "one under way: call ~/start_recording first")
        path, begun = self._path, self._writer is not None
        self.unsubscribe()
        self.release_frames()
        self.forget()
        return f"recorded {path}" if begun else f"{path} was not begun: no sketch/sensor came"

    def forget(self) -> None:
        """Finish the recording."""
        if self._writer is not None:
            self._writer.close()
        self._writer = self._path = None
        self.diagnostics.show(path="")

    def _on_sensor(self, message: String) -> None:
        sensor, self._frequencies, window_frames = sketch_message.decode_sensor(message)
        if self._writer is None and self._path is not None:
            facts = {"srt3d_ros": __version__, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                     "bin_width_s": sensor.bin_width_s, "frame_id": sensor.frame_id,
                     "frequencies": list(self._frequencies), "window_frames": window_frames}
            self.get_logger().info(f"recording to {self._path}")
            self._writer = RecordingWriter(
                self._path, sensor, properties=facts, on_error=self._on_writer_error,
                queue_frames=LOSSLESS_WRITER_QUEUE if self.lossless else WRITER_QUEUE)
            self.release_frames()

    def _on_points(self, raw: bytes) -> None:
        self._check_begun()
        received_ns = self.now_ns()
        header, columns = points_message.decode_cdr(raw)
        index = self._index(header.stamp_ns)
        xyz = columns["xyz"]
        self._writer.log_cloud(header.stamp_ns, index, xyz, columns["intensity"])
        latency_ms = (received_ns - header.stamp_ns) * 1e-6
        self._writer.log_scalars(header.stamp_ns, {"latency_ms": latency_ms, "points": len(xyz)}, index)
        self.diagnostics.count(clouds=1, points=len(xyz))
        self._logged(header.stamp_ns)

    def _on_depth(self, raw: bytes) -> None:
        self._check_begun()
        header, depth_m = image_message.decode_cdr(raw)
        self._writer.log_depth(header.stamp_ns, self._index(header.stamp_ns), depth_m)
        self._logged(header.stamp_ns)

    def _on_sketch(self, raw: bytes) -> None:
        self._check_begun()
        header, sketch = sketch_message.decode_cdr(raw, self._frequencies)
        photons = int(sketch.photons.sum())
        self._writer.log_scalars(header.stamp_ns, {"photons": photons}, self._index(header.stamp_ns))
        self.diagnostics.count(photons=photons)
        self._logged(header.stamp_ns)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._drops.add(message, self.get_namespace())
        if self._writer is not None and self._indices:
            self._writer.log_scalars(max(self._indices), {"drops": self._drops.total})

    def _on_writer_error(self, text: str) -> None:
        self.get_logger().error(text)
        self.diagnostics.error(text)

    def _logged(self, stamp_ns: int) -> None:
        self.sent(stamp_ns)
        self.diagnostics.show(recording_dropped=self._writer.dropped)

    def _index(self, stamp_ns: int) -> int:
        """The number of the frame with this stamp, in the order in which stamps were first seen."""
        if stamp_ns not in self._indices:
            self._indices[stamp_ns] = self._frames_seen
            self._frames_seen += 1
            if len(self._indices) > STAMPS_KEPT:
                del self._indices[next(iter(self._indices))]
        return self._indices[stamp_ns]

    def _check_begun(self) -> None:
        """Frames that were under way when the recording ended are none of its."""
        if self._writer is None:
            raise Dropped("not_recording", "the recording has ended, or had not begun")


class Drops:
    """Frames dropped or lost by all nodes of a pipeline since this began; a node's restart does not set it back."""

    def __init__(self):
        self._latest: dict[str, int] = {}
        self.total = 0

    def add(self, message: DiagnosticArray, namespace: str) -> None:
        """Take in the reports of the pipeline's nodes in this namespace."""
        for status in message.status:
            if status.hardware_id != PIPELINE_ID or not f"/{status.name}".startswith(namespace.rstrip("/") + "/"):
                continue
            values = {pair.key: pair.value for pair in status.values}
            dropped = int(values["dropped"]) + int(values["message_lost"])
            before = self._latest.get(status.name, 0)
            self.total += dropped - before if dropped >= before else dropped
            self._latest[status.name] = dropped


def _numbered(path: Path, before: int) -> Path:
    """The path of a recording that comes after others, whose files stay."""
    if before == 0 or not path.exists():
        return path
    numbers = count(before + 1)
    return next(other for k in numbers if not (other := path.with_stem(f"{path.stem}_{k}")).exists())


def _checked_path(text: str) -> Path:
    path = Path(text or time.strftime("recording_%Y%m%dT%H%M%SZ.rrd", time.gmtime())).absolute()
    require(path.suffix == ".rrd", "path", text, "a path that ends with .rrd")
    folder = path.parent
    require(folder.is_dir() and os.access(folder, os.W_OK), "path", text, "a file in a folder that can be written")
    return path


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run([RecorderNode], args)


if __name__ == "__main__":
    sys.exit(main())
