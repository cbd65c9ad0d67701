"""reconstructor: `sketch` → `points`, and `depth`, `intensity` and `background` images while someone looks."""

import sys
import threading
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from std_msgs.msg import String

from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.device import DEVICES
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS, SKETCH_METHODS
from srt3d_ros.core.sensor import MAX_UPSAMPLING, SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.srt3d import DEFAULT_FALSE_ALARM_RATE, MAX_SURFACES, SRT3D
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.interface import LOSSLESS, Interface, Service
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.worker import Dropped

AS_PUBLISHED = "auto"
PIPELINES = ("latency", "throughput")
IN_FLIGHT = 2           # frames that may be under way at once
PARAMETERS = (
    Parameter("method", DEFAULT_METHOD, "How to reconstruct. " + "; ".join(
        f"{name}: {METHODS[name].about}" for name in SKETCH_METHODS) + ". All but srt3d are published with the "
        "sketcher's `frequencies` consecutive.", choices=SKETCH_METHODS),
    Parameter("surfaces", 1, "Surfaces that a pixel may see.", low=1, high=MAX_SURFACES, live=True),
    Parameter("false_alarm_rate", DEFAULT_FALSE_ALARM_RATE, "srt3d, smle: share of the pixels without a surface that "
              "may show a point.", low=1e-12, high=0.5, live=True),
    Parameter("background", BACKGROUNDS[0], "srt3d: how the background spreads over the bins: as the sensor's "
              "background_shape says (evenly without), evenly, or as each frame shows.", choices=BACKGROUNDS),
    Parameter("weighting", AS_PUBLISHED, "Weighting of the sketched data term; auto is identity for srt3d and what the "
              "others are published with.", choices=(AS_PUBLISHED, *WEIGHTINGS)),
    Parameter("warm_start", False, "srt3d: begin with the last frame's surfaces where this one's photons confirm them: "
              "less error while the scene goes on.", live=True),
    Parameter("pipeline", PIPELINES[0], "latency: a frame is published before the next one begins. throughput: one is "
              "published while the next is reconstructed, and on a GPU copied to and fro; more frames a second.",
              choices=PIPELINES),
    Parameter("upsampling", 1, "srt3d: finer pixels of `points` and of the images along the side of each pixel.",
              low=1, high=MAX_UPSAMPLING, live=True),
    Parameter("device", "auto", "Where to compute; auto takes the GPU if there is one.", choices=DEVICES),
    Parameter("fields", "xyzi", "Fields of `points`: x, y, z, intensity, or also depth_std, background, row, col, "
              "surface.", choices=("xyzi", "full"), live=True),
    Parameter("frame_id", "", "tf frame of what is published; the messages' own if empty.", live=True),
    LOSSLESS,
)

INTERFACE = Interface(
    "reconstructor",
    purpose="Reconstructs a 3D point cloud from each sketch with SRT3D, in the same time however many photons it "
    "stands for; on a GPU where there is one.",
    inputs=(topics.SKETCH_SENSOR, topics.SKETCH),
    outputs=(topics.POINTS, *topics.IMAGES, topics.CAMERA_INFO),
    services=(Service("reset", "forget the last frame's surfaces, with which `warm_start` begins"),),
    parameters=PARAMETERS,
    limits=("A pixel sees at most `surfaces` surfaces, the strongest first.",),
)

ANY_SENSOR = SensorModel(rows=8, cols=8, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))


class ReconstructorNode(PipelineNode):
    """Compiles before it subscribes, follows the latched `sketch/sensor`, and publishes a cloud a sketch."""

    interface = INTERFACE

    def __init__(self):
        super().__init__()
        # What publishes: in the worker itself, or beside it.
        self._publisher = self.add_stage() if self.parameters["pipeline"] == "throughput" else None
        self._in_flight = threading.Semaphore(IN_FLIGHT)
        self._sensor: SensorModel | None = None
        self.parameters.on_change = lambda: self.worker.call(self._rebuild)

    def configure(self) -> None:
        """Compile and advertise."""
        self._reconstructor = self._build(ANY_SENSOR, (1, 2, 3))        # compiles, or says that there is no such device
        self._points = self.advertise("points")
        self._images = {topic.name: self.advertise(topic.name) for topic in topics.IMAGES}
        self._camera_info = self.advertise("camera_info")
        self.serve("reset", self._reset)

    def activate(self) -> None:
        """Follow the sketches and their description."""
        self._sensor = None
        self._frequencies: tuple[int, ...] = ()
        self.hold_frames_for("the sketch's description on sketch/sensor")
        self.follow("sketch/sensor", self._on_sensor)
        self.subscribe("sketch", self._on_sketch)

    def forget(self) -> None:
        """Begin the next frame without the last one's surfaces."""
        if isinstance(self._reconstructor, SRT3D):
            self._reconstructor.forget()

    def _reset(self) -> str:
        self.forget()
        return "the next frame begins without the last one's surfaces"

    def _build(self, sensor: SensorModel, frequencies: tuple[int, ...]):
        method = METHODS[self.parameters["method"]]
        options = {name: self.parameters[name] for name in ("surfaces", "device", *method.options)}
        if options.get("weighting") == AS_PUBLISHED:
            del options["weighting"]
        reconstructor = method.build(sensor, frequencies, **options)
        reconstructor.warm_up()
        return reconstructor

    def _rebuild(self) -> None:
        if self._sensor is not None:
            self._reconstructor = self._build(self._sensor, self._frequencies)

    def _on_sensor(self, message: String) -> None:
        sensor, frequencies, window_frames = sketch_message.decode_sensor(message)
        if frequencies != self._frequencies or not sensor.same_as(self._sensor):
            self._reconstructor = self._build(sensor, frequencies)
            self._sensor, self._frequencies = sensor, frequencies
        self.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins, window_frames=window_frames,
                              frequencies=" ".join(map(str, frequencies)), device=self._reconstructor.device)
        self.release_frames()

    def _on_sketch(self, raw: bytes) -> None:
        if self._sensor is None:
            raise Dropped("no_sensor", "nobody has described the sketch on `sketch/sensor` yet")
        header, sketch = sketch_message.decode_cdr(raw, self._frequencies, self._sensor)
        photons, sensor = int(sketch.photons.sum()), self._reconstructor.sensor
        frame_id = self.parameters["frame_id"] or header.frame_id
        if self._publisher is None:
            self._publish(self._begin(sketch), sensor, frame_id, photons)
            return
        self._in_flight.acquire()
        try:
            self._publisher.offer(self._publish_beside, self._begin(sketch), sensor, frame_id, photons)
        except BaseException:
            self._in_flight.release()
            raise

    def _begin(self, sketch: Sketch) -> Callable[[], PointCloud]:
        """Begin to reconstruct; what is returned waits for the cloud."""
        started = time.perf_counter()
        submit = getattr(self._reconstructor, "submit", None)
        wait = submit(sketch) if submit else partial(lambda cloud: cloud, self._reconstructor(sketch))

        def finish() -> PointCloud:
            cloud = wait()
            self.diagnostics.show(reconstruct_ms=f"{(time.perf_counter() - started) * 1e3:.2f}")
            return cloud

        return finish

    def _publish_beside(self, *frame) -> None:
        try:
            self._publish(*frame)
        finally:
            self._in_flight.release()

    def _publish(self, wait: Callable[[], PointCloud], sensor: SensorModel, frame_id: str, photons: int) -> None:
        cloud = wait()
        data = points_message.encode_cdr(cloud, frame_id, self.parameters["fields"], sensor)
        self.publish_frame(self._points, data, cloud.stamp_ns)
        self.diagnostics.count(points=len(cloud), photons=photons)
        self._publish_images(cloud, sensor, frame_id)

    def _publish_images(self, cloud: PointCloud, sensor: SensorModel, frame_id: str) -> None:
        draw = {"depth": cloud.range_image, "intensity": lambda: cloud.image("intensity"),
                "background": lambda: cloud.background}
        for name, publisher in self._images.items():
            if publisher.get_subscription_count():
                publisher.publish(image_message.encode_cdr(draw[name](), cloud.stamp_ns, frame_id))
        if self._camera_info.get_subscription_count():
            camera_info = image_message.camera_info(sensor, cloud.stamp_ns, frame_id)
            if camera_info is not None:         # a scanner is no camera
                self._camera_info.publish(camera_info)


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run([ReconstructorNode], args)


if __name__ == "__main__":
    sys.exit(main())
