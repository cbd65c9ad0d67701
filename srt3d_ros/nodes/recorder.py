"""recorder: `points`, `depth`, photon counts and the pipeline's health → a recording (.rrd)."""

import os
import sys
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros import __version__
from srt3d_ros.errors import require
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.base import OVERRIDABLE, PipelineNode
from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.recording.writer import RecordingWriter

QUEUE = 64              # messages that may wait; the writer has its own, shorter queue of clouds and images
WRITER_QUEUE, LOSSLESS_WRITER_QUEUE = 8, 256
STAMPS_KEPT = 256

PARAMETERS = (
    Parameter("path", "", "The recording, replaced if it exists; recording_<UTC time>.rrd in the working directory if "
              "empty.", form="a path that ends with .rrd"),
    Parameter("lossless", False, "Queue more before dropping: for replays faster than a sensor."),
)


class RecorderNode(PipelineNode):
    """Starts the recording when the first `sketch/sensor` has come and finishes it when the node is closed."""

    def __init__(self):
        super().__init__("recorder", PARAMETERS, QUEUE)
        self._writer: RecordingWriter | None = None

    def configure(self) -> None:
        """Check the path, then follow what is to be recorded."""
        self._path = _checked_path(self.parameters["path"])
        self._frequencies: tuple[int, ...] = ()
        self._indices: dict[int, int] = {}
        self._frames_seen = 0
        self._drops = Drops()
        self.hold_frames_for("the sketch's description on sketch/sensor")
        self.subscribe_latched(String, "sketch/sensor", self._on_sensor)
        self.subscribe(PointCloud2, "points", self._on_points)
        self.subscribe(Image, "depth", self._on_depth)
        self.subscribe(PointCloud2, "sketch", self._on_sketch)
        self.create_subscription(
            DiagnosticArray, "/diagnostics", lambda message: self.worker.call(self._on_diagnostics, message),
            QoSProfile(depth=100), qos_overriding_options=OVERRIDABLE)
        self.diagnostics.show(path=self._path)

    def _on_sensor(self, message: String) -> None:
        sensor, self._frequencies, window_frames = sketch_message.decode_sensor(message)
        if self._writer is None:
            facts = {"srt3d_ros": __version__, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                     "bin_width_s": sensor.bin_width_s, "frame_id": sensor.frame_id,
                     "frequencies": list(self._frequencies), "window_frames": window_frames}
            self.get_logger().info(f"recording to {self._path}")
            self._writer = RecordingWriter(
                self._path, sensor, properties=facts, on_error=self._on_writer_error,
                queue_frames=LOSSLESS_WRITER_QUEUE if self.lossless else WRITER_QUEUE)
            self.release_frames()

    def _on_points(self, raw: bytes) -> None:
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
        header, depth_m = image_message.decode_cdr(raw)
        self._writer.log_depth(header.stamp_ns, self._index(header.stamp_ns), depth_m)
        self._logged(header.stamp_ns)

    def _on_sketch(self, raw: bytes) -> None:
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

    def close(self) -> None:
        """Write what has arrived, finish the recording, leave the graph."""
        self.worker.close(drain=self._writer is not None)
        if self._writer is not None:
            self._writer.close()
        super().close()


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


def _checked_path(text: str) -> Path:
    path = Path(text or time.strftime("recording_%Y%m%dT%H%M%SZ.rrd", time.gmtime())).absolute()
    require(path.suffix == ".rrd", "path", text, "a path that ends with .rrd")
    folder = path.parent
    require(folder.is_dir() and os.access(folder, os.W_OK), "path", text, "a file in a folder that can be written")
    return path


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
