"""reconstructor: `sketch` → `points`, and images to their subscribers."""

import time
from functools import partial

import numpy as np

from srt3d_ros import precompile
from srt3d_ros.core.method.pile_up import SATURATED, saturated
from srt3d_ros.core.methods import METHODS, OPTIONS, SKETCH_METHODS, checked
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.signs_of_life import FreeSpaceStream
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.errors import require
from srt3d_ros.kernels.devices import kernels_for
from srt3d_ros.messages import images_message, points_message, sketch_message
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.managed_node import ManagedNode, sensor_summary
from srt3d_ros.nodes.common.parameters import Parameter, Values
from srt3d_ros.nodes.common.process import run
from srt3d_ros.nodes.common.topics import NodeSpec
from srt3d_ros.nodes.common.worker import Dropped
from srt3d_ros.nodes.motion_input import MOTION, MotionInput
from srt3d_ros.nodes.sketch_queue import QueuedSketch, SketchQueue
from srt3d_ros.reconstruction import Reconstructor

PARAMETERS = (
    Parameter.of(OPTIONS["method"], description="How to reconstruct. " + "; ".join(
        f"{name}: {METHODS[name].about}" for name in SKETCH_METHODS) + ". The papers of the other methods "
        "use the sketcher's `frequencies: consecutive`.", choices=SKETCH_METHODS),
    Parameter.of(OPTIONS["surfaces"]),
    *(Parameter.of(OPTIONS[name]) for name in ("false_alarm_rate", "background", "window_frames", "device")),
    Parameter("fields", "xyzi", "Fields of `points`. xyzi: x, y, z, intensity. full: also depth_std, background, row, "
              "col and surface.", choices=("xyzi", "full"), live=True),
    Parameter("organised", False, "Publish `points` as an image of rows × cols: the strongest point of each pixel, "
              "NaN where there is none. false: all points, in a list.", live=True),
    topics.MAX_PIXELS_PARAMETER,
    Parameter("min_range_m", 0.0, "Omit points nearer than this along their pixel's ray, from `points` and images; 0 "
              "= no limit.", "m", low=0.0, live=True),
    Parameter("max_range_m", 0.0, "Omit points farther than this; 0 = no limit.", "m", low=0.0, live=True),
    Parameter("free_brightness", 0.0, "Publish on `free` how far pixels without a point hold nothing so bright or "
              "brighter: signal photons that the darkest object of interest sends into a pixel in a frame from 1 m "
              "(docs/robot-stack.md says how to measure it); 0 = nothing is claimed. Only with method pooled and "
              "`window_frames` of 1.", "photons", low=0.0, live=True),
)


def options(values: Values) -> Values:
    """The parameters of the Reconstructor; the others concern what is published."""
    return {name: values[name] for name in OPTIONS}


SPEC = NodeSpec(
    "reconstructor",
    inputs=(topics.SKETCH_SENSOR, topics.SKETCH, topics.ODOM),
    outputs=(topics.POINTS, topics.FREE, *topics.IMAGE_TOPICS, topics.CAMERA_INFO),
    parameters=PARAMETERS,
)


BUILT_KEPT = 2      # reconstructors: sketches for the previous one may still arrive after the first for a new one
WAITED_FOR = "the sketch's description"


class ReconstructorNode(ManagedNode):
    """Publishes a cloud for each sketch, reconstructed with the description that the sketch names."""

    spec = SPEC
    _motion: MotionInput | None = None          # of windows
    _before_ns = 0                              # stamp of the last sketch

    def __init__(self):
        super().__init__()
        self._queue = SketchQueue()
        self._built: dict[tuple[str, tuple[int, ...]], Reconstructor] = {}      # the last used comes last
        self._free_of: tuple | None = None          # the sensor and the frequencies that `_free` is for
        self._settings = self.parameters.as_dict()      # the worker's copy, which changes only between frames

    def configure(self) -> None:
        self._settings = self.parameters.as_dict()
        self.check(self._settings)
        # On the CPU, since a GPU's kernels depend on the sensor.
        Reconstructor(precompile.ANY_SENSOR, (1, 2, 3), **options(self._settings | {"device": "cpu"})).warm_up()
        self._points = self.endpoints.advertise(topics.POINTS)
        self._ends = self.endpoints.advertise(topics.FREE)
        self._images = {topic.name: self.endpoints.advertise(topic) for topic in topics.IMAGE_TOPICS}
        self._camera_info = self.endpoints.advertise(topics.CAMERA_INFO)

    def activate(self) -> None:
        self._sensors = self.resolve_topic_name("sketch/sensor")
        self.diagnostics.wait_for(WAITED_FOR, self._sensors)
        # Subscribe to the description last: a publisher that has found this reader has found that of `sketch`, too.
        self.subscribe(topics.SKETCH, self._on_sketch)
        self.follow(topics.SKETCH_SENSOR, self._on_sensor)

    def stop_frames(self, cause: str) -> None:
        super().stop_frames(cause)
        self.diagnostics.drop(cause, self._queue.clear())

    def forget(self) -> None:
        """Forget the last frames' surfaces, background and signs of life, and the motion of the sensor."""
        self._built.clear()
        self._free_of = None
        self.endpoints.unsubscribe()            # the worker may have subscribed since `unsubscribe`
        self._motion = None

    def check(self, values: Values) -> None:
        """Raise InvalidInput for values that contradict each other, or that this machine cannot use."""
        checked(options(values))
        kernels_for(values["device"])
        nearest, farthest = values["min_range_m"], values["max_range_m"]
        require(farthest == 0 or nearest < farthest, "min_range_m", nearest, f"less than max_range_m, {farthest:g} m")
        brightness, method, window = (values[name] for name in ("free_brightness", "method", "window_frames"))
        require(brightness == 0 or method == "pooled", "free_brightness", brightness,
                f"0 with method {method}: only pooled tells what is empty")
        require(brightness == 0 or window == 1, "free_brightness", brightness, f"0 with window_frames {window}: what "
                "appears is found later in a window; run a second reconstructor with window_frames 1 for free, its "
                "points remapped")

    def apply_parameters(self) -> None:
        settings = self.parameters.as_dict()
        if options(settings) != options(self._settings):
            self._built.clear()
        self._settings = settings

    def _on_sensor(self, raw: bytes) -> None:
        sensor = self.check_size(self._queue.describe(raw))
        self.diagnostics.problem, self.diagnostics.frame_id = "", sensor.frame_id
        self.diagnostics.show(rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins)
        self._hear_motion_of(sensor)
        self._reconstruct_all()

    def _on_sketch(self, raw: bytes) -> None:
        self._queue.add(raw, time.monotonic())
        self._reconstruct_all()

    def _reconstruct_all(self) -> None:
        """Reconstruct the sketches whose description has arrived; drop those that have waited too long for theirs."""
        ready, dropped = self._queue.take(time.monotonic())
        self.diagnostics.wait_for(f"{WAITED_FOR} sensor_{self._queue.missing}" if self._queue else "", self._sensors)
        for sensor, queued in ready:
            try:
                self._reconstruct(sensor, queued)
            except Exception as error:
                self.failed(error, frames=1)
        for queued in dropped:
            self.failed(Dropped("no_sensor", f"{WAITED_FOR} sensor_{queued.digest} did not arrive on {self._sensors}"),
                        frames=1)

    def _reconstruct(self, sensor: SensorModel, queued: QueuedSketch) -> None:
        sketch = sketch_message.decode(queued.message, self.check_size(sensor))
        reconstructor = self._reconstructor(queued.digest, sketch)
        seen = reconstructor(sketch, self._trajectory(sketch))
        self._warn_of_saturation(sketch)
        if seen.photons and seen.notes:
            self.diagnostics.warn(seen.notes[-1])
        light = seen.background.sum() + seen.intensity.sum() if sketch.cycles else seen.photons
        share = float(seen.background.sum()) / max(light, 1)
        self.diagnostics.show(reconstruct_ms=f"{seen.reconstruct_ms:.2f}", background_share=f"{share:.3f}",
                              background_unevenness=f"{reconstructor.uneven_background:.4f}")
        self._publish(seen, sketch, queued.message.header.frame_id or sensor.frame_id)

    def _warn_of_saturation(self, sketch: PhaseSums) -> None:
        """Report the pixels with a photon in nearly every laser cycle, whose pile-up cannot be corrected well."""
        pixels = 0
        if sketch.cycles:
            pixels = int(saturated(sketch).sum())
            self.diagnostics.show(cycles=sketch.cycles, saturated_pixels=pixels)
        warning = f"saturated pixels: {pixels} (a photon in over {SATURATED:.0%} of the cycles)"
        self.diagnostics.degrade("saturation", warning if pixels else "")

    def _hear_motion_of(self, sensor: SensorModel) -> None:
        """Subscribe to `odom` for windows of a sensor that moves, unless that is done."""
        if self._motion is None and self._settings["window_frames"] > 1 and sensor.extrinsics:
            self._motion = MotionInput(self, lambda: None)

    def _trajectory(self, sketch: PhaseSums) -> Trajectory | None:
        """The sensor's motion since the last sketch, for a window; empty if it is not known, None if it is at rest."""
        self._hear_motion_of(sketch.sensor)
        mount, (before_ns, self._before_ns) = sketch.sensor.extrinsics, (self._before_ns, sketch.stamp_ns)
        if self._motion is None or not mount or self._settings["window_frames"] == 1:
            self.diagnostics.degrade(MOTION, "")
            return None
        first_ns = min(before_ns or sketch.stamp_ns, sketch.stamp_ns)
        trajectory, cause = self._motion.over(mount, first_ns, sketch.stamp_ns, late=True)
        self._motion.judge(cause and f"windows of one frame: {cause}", "windows follow the motion again")
        return trajectory or Trajectory()

    def _reconstructor(self, digest: str, sketch: PhaseSums) -> Reconstructor:
        """The Reconstructor for a description and frequencies, with its memory of their last frames."""
        kind, frequencies = (digest, sketch.frequencies), " ".join(map(str, sketch.frequencies))
        reconstructor = self._built.pop(kind, None)
        if reconstructor is None:
            reconstructor = Reconstructor(sketch.sensor, sketch.frequencies, **options(self._settings))
            reconstructor.warm_up()
            self.get_logger().info(f"sketches: {sensor_summary(sketch.sensor)}, frequencies {frequencies}")
        self._built[kind] = reconstructor
        if len(self._built) > BUILT_KEPT:
            del self._built[next(iter(self._built))]
        self.diagnostics.show(device=f"{reconstructor.device}: {reconstructor.device_reason}", frequencies=frequencies)
        return reconstructor

    def _publish(self, seen: PointCloud, sketch: PhaseSums, frame_id: str) -> None:
        settings = self._settings
        cloud = seen.within(settings["min_range_m"], settings["max_range_m"] or np.inf)
        organised = settings["organised"]
        data = points_message.encode_cdr(cloud, frame_id, settings["fields"], organised)
        self.publish_frame(self._points, data, cloud.stamp_ns)
        published = int(np.count_nonzero(cloud.surface == 0)) if organised else len(cloud)
        self.diagnostics.count(points=published, points_out_of_range=len(seen) - len(cloud), photons=seen.photons)
        try:
            free_m = self._free_range_m(seen, sketch)
            if free_m is not None:
                ends = points_message.encode_ends_cdr(free_m, sketch.sensor, cloud.stamp_ns, frame_id)
                self.publish(self._ends, ends)
            self._publish_images(cloud, sketch.sensor, frame_id, free_m)
        except Exception as problem:    # not counted as a lost frame: its points have been published
            self.failed(problem)

    def _free_range_m(self, seen: PointCloud, sketch: PhaseSums) -> np.ndarray | None:
        """How far pixels are empty, for readers of `free` and `depth`; None without, and signs of life begin anew."""
        brightness, kind = self._settings["free_brightness"], (sketch.sensor, sketch.frequencies)
        readers = (self._ends, self._images["depth"])
        if not brightness or not any(each.get_subscription_count() for each in readers):
            self._free_of = None
            return None
        if kind != self._free_of:
            self._free_of, self._free = kind, FreeSpaceStream(*kind)
        return self._free(sketch, seen, brightness, self._settings["max_range_m"], self._settings["false_alarm_rate"])

    def _publish_images(self, cloud: PointCloud, sensor: SensorModel, frame_id: str, free_m: np.ndarray | None
                        ) -> None:
        for name, publisher in self._images.items():
            if not publisher.get_subscription_count():
                continue
            if name == "depth":
                image = cloud.depth_image()
                if free_m is not None:
                    image[free_m >= self._free.end_m(self._settings["max_range_m"])] = np.inf
            else:
                image = cloud.image(name) if name == "intensity" else cloud.background
            self.publish(publisher, images_message.encode_cdr(image, cloud.stamp_ns, frame_id))
        if self._camera_info.get_subscription_count():
            info = images_message.camera_info(sensor, cloud.stamp_ns, frame_id)
            if info is not None:        # None for a scanner, which is no camera
                self.publish(self._camera_info, info)


main = partial(run, ReconstructorNode)
