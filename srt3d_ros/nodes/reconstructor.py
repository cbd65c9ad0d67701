"""reconstructor: `sketch` → `points`, and `depth`, `intensity` and `background` images while someone looks."""

import sys
import time

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS, SKETCH_METHODS
from srt3d_ros.core.sensor import MAX_UPSAMPLING, SensorModel
from srt3d_ros.core.srt3d import DEFAULT_FALSE_ALARM_RATE, DEVICES, MAX_SURFACES
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.base import LOSSLESS_PARAMETER, PipelineNode
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.worker import Dropped

AS_PUBLISHED = "auto"
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
    Parameter("upsampling", 1, "srt3d: finer pixels of `points` and of the images along the side of each pixel.",
              low=1, high=MAX_UPSAMPLING, live=True),
    Parameter("device", "auto", "Where to compute; auto takes the GPU if there is one.", choices=DEVICES),
    Parameter("fields", "xyzi", "Fields of `points`: x, y, z, intensity, or also depth_std, background, row, col, "
              "surface.", choices=("xyzi", "full"), live=True),
    Parameter("frame_id", "", "tf frame of what is published; the messages' own if empty.", live=True),
    LOSSLESS_PARAMETER,
)

ANY_SENSOR = SensorModel(rows=8, cols=8, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))


class ReconstructorNode(PipelineNode):
    """Compiles before it subscribes, follows the latched `sketch/sensor`, and publishes a cloud a sketch."""

    def __init__(self):
        super().__init__("reconstructor", PARAMETERS)

    def configure(self) -> None:
        """Compile, then follow the sketches and their description."""
        self._sensor: SensorModel | None = None
        self._frequencies: tuple[int, ...] = ()
        self._reconstructor = self._build(ANY_SENSOR, (1, 2, 3))        # compiles, or says that there is no such device
        self.parameters.on_change = lambda: self.worker.call(self._rebuild)
        self._points = self.advertise(PointCloud2, "points")
        self._images = {name: self.advertise(Image, name) for name in ("depth", "intensity", "background")}
        self._camera_info = self.advertise(CameraInfo, "camera_info")
        self.hold_frames_for("the sketch's description on sketch/sensor")
        self.subscribe_latched(String, "sketch/sensor", self._on_sensor)
        self.subscribe(PointCloud2, "sketch", self._on_sketch)

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
        started = time.perf_counter()
        cloud = self._reconstructor(sketch)
        self.diagnostics.show(reconstruct_ms=f"{(time.perf_counter() - started) * 1e3:.2f}")
        frame_id = self.parameters["frame_id"] or header.frame_id
        data = points_message.encode_cdr(cloud, frame_id, self.parameters["fields"],
                                         self._reconstructor.sensor)
        self.publish_frame(self._points, data, cloud.stamp_ns)
        self.diagnostics.count(points=len(cloud), photons=int(sketch.photons.sum()))
        self._publish_images(cloud, frame_id)

    def _publish_images(self, cloud: PointCloud, frame_id: str) -> None:
        draw = {"depth": cloud.range_image, "intensity": lambda: cloud.image("intensity"),
                "background": lambda: cloud.background}
        for name, publisher in self._images.items():
            if publisher.get_subscription_count():
                publisher.publish(image_message.encode_cdr(draw[name](), cloud.stamp_ns, frame_id))
        if self._camera_info.get_subscription_count():
            camera_info = image_message.camera_info(self._reconstructor.sensor, cloud.stamp_ns, frame_id)
            if camera_info is not None:         # a scanner is no camera
                self._camera_info.publish(camera_info)


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run(ReconstructorNode, args)


if __name__ == "__main__":
    sys.exit(main())
