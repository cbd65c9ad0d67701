"""reconstructor: `sketch` → `points`, and `depth`, `intensity` and `background` images while somebody subscribes."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from std_msgs.msg import String

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.camera import camera_info
from srt3d_ros.new_files import free
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Value
from srt3d_ros.nodes.reconstructor_parameters import PARAMETERS, build, check_together, limits_m, options
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.sensor_choice import in_words
from srt3d_ros.nodes.worker import Refused, drop_outdated
from srt3d_ros.recording import cloud_files

SPEC = NodeSpec(
    "reconstructor",
    inputs=(topics.SKETCH_SENSOR, topics.SKETCH),
    outputs=(topics.POINTS, *topics.IMAGES, topics.CAMERA_INFO),
    services=("reset", "save_cloud"),
    parameters=PARAMETERS,
)


@dataclass(frozen=True, eq=False)
class Description:
    """What sketches are, and what reconstructs them. `valid_from_ns`: when it was sent, by the sender's clock."""

    sensor: SensorModel
    frequencies: tuple[int, ...]
    reconstructor: Callable[[Sketch], PointCloud]
    valid_from_ns: int


class ReconstructorNode(PipelineNode):
    """Compiles before it subscribes, follows the latched `sketch/sensor`, and publishes a cloud a sketch."""

    spec = SPEC

    def __init__(self):
        super().__init__()
        self._described: Description | None = None
        self._former: Description | None = None     # whose last sketches may still be on their way
        self._refused: String | None = None     # a description that these parameters cannot be used with
        self._newest: tuple[PointCloud, Description, str] | None = None    # and its frame_id
        self.parameters.on_check = self._check
        self.parameters.on_change = lambda: self.worker.call(self._apply)

    def configure(self) -> None:
        self._settings = self.parameters.as_dict()      # the worker's copy, which changes between frames
        check_together(self._settings)
        build(None, self._settings).warm_up()
        self._points = self.advertise("points")
        self._images = {topic.name: self.advertise(topic.name) for topic in topics.IMAGES}
        self._camera_info = self.advertise("camera_info")
        self.serve("reset", self._reset)
        self.serve("save_cloud", self._save_cloud)

    def activate(self) -> None:
        self._described = self._former = self._refused = None
        self.hold_frames_for("the sketch's description on sketch/sensor")
        self.follow("sketch/sensor", self._on_sensor)
        self.subscribe("sketch", self._on_sketch, handle_outdated=self._on_outdated_sketch)

    def forget(self) -> None:
        """Forget the last frame's surfaces and background, and the newest cloud."""
        self._newest = None
        if self._described is not None and isinstance(self._described.reconstructor, Pooled):
            self._described.reconstructor.forget()

    def _reset(self) -> str:
        self.forget()
        return "the next frame begins without the last one's surfaces"

    def _save_cloud(self) -> str:
        if self._newest is None:
            raise Refused(f"no cloud to save yet: no sketch has arrived on {self.resolve_topic_name('sketch')}")
        cloud, described, frame_id = self._newest
        folder = Path(self._settings["save_folder"]).expanduser().absolute()
        path = free(folder / f"cloud_{cloud.stamp_ns}.ply")
        cloud_files.save(cloud, path, frequencies=described.frequencies,
                         sensor=described.sensor.replace(frame_id=frame_id))
        return f"{len(cloud)} points saved as {path}"

    def _check(self, values: dict[str, Value]) -> None:
        """Refuse parameters that could not be applied."""
        check_together(values)
        if options(values) != options(self.parameters.as_dict()):
            build(self._described and (self._described.sensor, self._described.frequencies), values)

    def _apply(self) -> None:
        """Use the present parameters from the next frame on."""
        settings = self.parameters.as_dict()
        described = self._described
        if described is not None and options(settings) != options(self._settings):
            reconstructor = self._build(described.sensor, described.frequencies, settings)
            self._described, self._former = replace(described, reconstructor=reconstructor), None
        self._settings = settings
        if self._refused is not None:
            self._on_sensor(self._refused)

    def _build(self, sensor: SensorModel, frequencies: tuple[int, ...],
               settings: dict[str, Value]) -> Callable[[Sketch], PointCloud]:
        reconstructor = build((sensor, frequencies), settings)
        reconstructor.warm_up()
        self.diagnostics.show(device=reconstructor.device)
        return reconstructor

    def _on_sensor(self, message: String) -> None:
        self._refused = message
        sensor, frequencies, window_frames = sketch_message.decode_sensor(message)
        before = self._described
        if before is None or frequencies != before.frequencies or not sensor.same_as(before.sensor):
            reconstructor = self._build(sensor, frequencies, self._settings)
            if before is not None:
                self.drop_older()
            self._described = Description(sensor, frequencies, reconstructor, self.valid_from_ns)
            self._former = before
            self.get_logger().info(f"sketches: {in_words(sensor)}, {len(frequencies)} frequencies")
        self._refused = None
        self.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins, window_frames=window_frames,
                              frequencies=" ".join(map(str, frequencies)))
        self.release_frames()

    def _on_sketch(self, raw: bytes) -> None:
        self._former = None         # its sketches have all come
        self._reconstruct(raw, self._described)

    def _on_outdated_sketch(self, raw: bytes, sent_ns: int) -> None:
        """Reconstruct a sketch that its successor's description overtook."""
        if self._former is None or sent_ns < self._former.valid_from_ns:
            drop_outdated()
        self.diagnostics.count(overtaken=1)
        self._reconstruct(raw, self._former)

    def _reconstruct(self, raw: bytes, described: Description) -> None:
        header, sketch = sketch_message.decode_cdr(raw, described.frequencies, described.sensor)
        started = time.perf_counter()
        seen = described.reconstructor(sketch)
        photons, background = int(sketch.photons.sum()), float(seen.background.sum())
        self.diagnostics.show(reconstruct_ms=f"{(time.perf_counter() - started) * 1e3:.2f}",
                              background_share=f"{background / max(photons, 1):.3f}")
        if isinstance(described.reconstructor, Pooled):
            self.diagnostics.show(background_unevenness=f"{described.reconstructor.uneven_background:.4f}")
        self._publish(seen, photons, described, header.frame_id)

    def _publish(self, seen: PointCloud, photons: int, described: Description, frame_id: str) -> None:
        settings, sensor = self._settings, described.sensor
        cloud = seen.within(*limits_m(settings)).ordered(settings["surface_order"])
        data = points_message.encode_cdr(cloud, frame_id, settings["fields"], sensor, settings["organised"])
        self.publish_frame(self._points, data, cloud.stamp_ns)
        self.diagnostics.count(points=len(cloud), points_out_of_range=len(seen) - len(cloud), photons=photons)
        self._newest = cloud, described, frame_id
        try:
            self._publish_images(cloud, sensor, frame_id)
        except Exception as problem:    # does not concern the frame: it was published
            self.failed(problem)

    def _publish_images(self, cloud: PointCloud, sensor: SensorModel, frame_id: str) -> None:
        draw = {"depth": partial(cloud.depth_image, sensor.projection), "intensity": partial(cloud.image, "intensity"),
                "background": lambda: cloud.background}
        for name, publisher in self._images.items():
            if publisher.get_subscription_count():
                publisher.publish(image_message.encode_cdr(draw[name](), cloud.stamp_ns, frame_id))
        if self._camera_info.get_subscription_count():
            info = camera_info(sensor, cloud.stamp_ns, frame_id)
            if info is not None:        # a scanner is no camera
                self._camera_info.publish(info)


main = partial(run, ReconstructorNode)
