"""sketcher: `photons`, `gates` or `histograms` → `sketch`, m complex numbers per pixel instead of the photons."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from srt3d_ros import precompile
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import OPTIONS
from srt3d_ros.core.sketching.frequencies import RULES
from srt3d_ros.core.sketching.gate import OFF
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.core.sketching.plausibility import LightWatch
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.core.stream import SketchStream, StreamOptions
from srt3d_ros.datasets import open_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels.devices import compile_kernels
from srt3d_ros.messages import cdr, sensor_message, sketch_message
from srt3d_ros.messages.photon_frames import CODECS, Codec
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.managed_node import ManagedNode, sensor_summary
from srt3d_ros.nodes.common.parameters import Parameter, Values
from srt3d_ros.nodes.common.process import run
from srt3d_ros.nodes.common.worker import Dropped
from srt3d_ros.nodes.motion_input import MotionInput, motion_parameters

AT_ORIGIN = "0 0 0 0 0 0 1"
POLL_S = 0.1                # a frame ends by silence after 0.5 s or more, and waits for motion for 1 s
LIKELY_PACKETS = 8          # assumed per frame_period_s until the first period has ended
PARAMETERS = (
    Parameter("sensor_file", "", "Description of the sensor, for a driver that publishes none: JSON as on `sensor`, "
              "or a photon file. If a driver publishes a different description on `sensor`, its photons are dropped, "
              "and an error in the log and in /diagnostics names the first key that differs.",
              form="a path"),
    Parameter.of(OPTIONS["sketch_size"]),
    Parameter.of(OPTIONS["frequencies"]),
    Parameter("gate", OFF, "First and last depth bin to keep. Photons in other bins are dropped "
              "(`photons_dropped.gate`), and T becomes the gate's length: less background and finer depths at a low "
              "SBR. `srt3d info FILE` proposes one. The spread of the pixels' delays widens it.",
              form="off, or first and last bin such as 100-400", live=True),
    Parameter("mask", "auto", "auto: leave out hot pixels, as the first second of photons shows them, unless the "
              "description has a mask. /diagnostics counts them (`hot_pixels`). A lamp of up to 2 × 2 pixels "
              "looks the same: look again by `deactivate` and `activate`, or measure a mask.",
              choices=("auto", OFF), live=True),
    Parameter("packets_per_frame", 1, "Messages per frame. With frame_period_s, 1 means any number.",
              low=1, high=100_000, live=True),
    Parameter("frame_period_s", 0.0, "Define frames by stamp: a frame contains the stamps of one period. It ends "
              "early once packets_per_frame have arrived. If the packets of a frame share one stamp, use any value up "
              "to the time between frames. 0: define frames by number only.",
              "s", 0, 1000, live=True),
    *motion_parameters(
        "Photons of a frame of several packets are moved to the sensor's pose in the middle of the frame, which "
        "becomes the stamp, before they are added. odom: nav_msgs/Odometry. imu: rotation only."),
    Parameter("layout", "float32", "Numbers in `sketch`; int16 halves the bandwidth.",
              choices=("float32", "int16"), live=True),
    topics.MAX_PIXELS_PARAMETER,
    Parameter("frame_id", "", "tf frame of the published messages; if empty, that of the received ones.", live=True),
)

SPEC = topics.NodeSpec(
    "sketcher",
    inputs=(topics.SENSOR, *topics.FRAMES, *topics.MOTION),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    parameters=PARAMETERS,
)


def stream_options(values: Values) -> StreamOptions:
    """The parameters that configure a SketchStream; InvalidInput if they contradict each other."""
    spec = values["frequencies"]
    return StreamOptions(values["gate"], spec, values["sketch_size"] if spec in RULES else None,
                         values["packets_per_frame"], round(values["frame_period_s"] * 1e9),
                         values["motion"] != OFF)


class SketcherNode(ManagedNode):
    """Pushes packets into a SketchStream and publishes its sketches.

    The sensor is that of `sensor_file`, with which a description on `sensor` must agree. Without a file, it is the last
    description on `sensor`. While a description contradicts the file or cannot be used, photons are dropped.
    """

    spec = SPEC
    _file: SensorModel | None = None            # the sensor of `sensor_file`
    _sensor: SensorModel | None = None          # of the photons
    _stream: SketchStream | None = None         # None while photons cannot be used
    _watch: LightWatch | None = None            # of the photons of `_sensor`
    _refused = ""                               # why the last description on `sensor` is not used
    _motion: MotionInput | None = None

    def __init__(self):
        super().__init__()
        self.create_timer(POLL_S, lambda: self.worker.call(self._poll))

    def configure(self) -> None:
        path = self.parameters["sensor_file"]
        self._file = self._sensor = self.check_size(open_sensor(path)) if path else None
        self.check(self.parameters.as_dict())
        compile_kernels("phase_sums")
        if self.parameters["motion"] != OFF:
            compile_kernels("move_sketch")
        if self._file is not None:
            self._file_publisher = self.endpoints.advertise(topics.SENSOR)
        self._sketches, self._descriptions = map(self.endpoints.advertise, (topics.SKETCH, topics.SKETCH_SENSOR))

    def activate(self) -> None:
        self.worker.messages_per_frame = max(self.parameters["packets_per_frame"],
                                             LIKELY_PACKETS if self.parameters["frame_period_s"] else 1)
        self._frame_id, self._described, self._own_description = "", None, ""
        self._sensor, self._refused = self._file, ""
        self._topic, self._file_name = self.resolve_topic_name("sensor"), Path(self.parameters["sensor_file"]).name
        if self._file is None:
            self.hold_frames_for("a sensor description", topics.SENSOR)
        else:
            self.get_logger().info(f"sensor_file {self._file_name}: {sensor_summary(self._file)}; a description on "
                                   f"{self._topic} must agree")
            # The writer tells it from an equal one.
            message = sensor_message.encode_cdr(self._file,
                                                x_writer=f"{self.get_fully_qualified_name()} {self.now_ns()}")
            self._file_publisher.publish(message)
            self._own_description = cdr.read_text(message)
            self.worker.call(self.apply_parameters)
        if self.parameters["motion"] != OFF:
            self._motion = MotionInput(self, self._on_motion, self.parameters["motion"])
            self.diagnostics.count(frames_deskewed=0, frames_undeskewed=0)
        self.follow(topics.SENSOR, self._on_sensor)
        for topic in topics.FRAMES:
            self.subscribe(topic, partial(self._on_packet, CODECS[topic.name]))

    def forget(self) -> None:
        self._flush()
        self._sensor, self._stream, self._motion, self._watch = self._file, None, None, None

    def _flush(self) -> None:
        """Publish all frames that have ended, and begin a new frame."""
        if self._stream is not None:
            self._publish(self._stream, self._stream.flush())

    # ---- Sensor and parameters

    def check(self, values: Values) -> None:
        """Raise InvalidInput for parameters that do not suit the sensor; without one, that suit no sensor."""
        cdr.check_frame_id("frame_id", values["frame_id"])
        Pose.from_text(values["extrinsics"])
        stream_options(values).check(self._sensor or precompile.ANY_SENSOR)

    def _on_sensor(self, raw: bytes) -> None:
        text = cdr.read_text(raw)
        if text == self._own_description:
            return
        try:
            described = self.check_size(sensor_message.from_json(text))
            if self._file is not None and (difference := first_difference(self._file, described)):
                key, ours, theirs = difference
                raise InvalidInput(f"{key} on {self._topic}", theirs, f"{ours} as in sensor_file {self._file_name}; "
                                   "photons are dropped until both agree")
        except InvalidInput as problem:
            if self._stream is not None:        # the open frame may contain photons of the other sensor
                self._publish(self._stream, self._stream.reset())
            self._stream, self._refused = None, str(problem)
            self.diagnostics.problem = self._refused
            raise
        if self._file is None:
            self._update_sensor(described)
        else:
            self._use_file(f"{self._topic} agrees again")

    def _update_sensor(self, described: SensorModel) -> None:
        """Sketch photons of the described sensor from now on; InvalidInput if the parameters do not suit it."""
        before = self._sensor
        if before is None:
            self.get_logger().info(f"sensor on {self._topic}: {sensor_summary(described)}")
        elif not described.same_as(before):
            difference = first_difference(before, described)
            changed = "{} was {}, is {}".format(*difference) if difference else "numbers differ in their last digits"
            self.get_logger().info(f"another sensor on {self._topic}: {sensor_summary(described)}; {changed}")
            self.drop_older_frames()
            self._watch = None
        self._sensor, self._refused = described, ""
        self.apply_parameters()

    def _use_file(self, reason: str) -> None:
        """Use the file's sensor again if a description has contradicted it."""
        if self._refused:
            self._refused = ""
            self.get_logger().info(f"sensor_file {self._file_name} is used again: {reason}")
            self.apply_parameters()

    def apply_parameters(self) -> None:
        """Apply sensor and parameters; if they change the sketches, begin a new frame. InvalidInput if they clash."""
        sensor, stream = self._sensor, self._stream
        if sensor is None or self._refused or self.stop_cause:
            return
        options = stream_options(self.parameters.as_dict())
        if options.moving:
            sensor = sensor.replace(extrinsics=self.parameters["extrinsics"].strip() or sensor.extrinsics or AT_ORIGIN)
        if self._watch is not None and self.parameters["mask"] != OFF:
            sensor = self._watch.masked(sensor)
        if stream is not None and stream.sensor.same_as(sensor) and options == stream.options:
            return
        self._flush()
        self._stream = None                     # stays so if the next line fails
        try:
            self._stream = stream = SketchStream(sensor, options, self.diagnostics)
        except InvalidInput as problem:
            self.diagnostics.problem = str(problem)
            raise
        if options.moving and sensor.extrinsics == AT_ORIGIN:
            self.get_logger().warning("extrinsics is empty: the sensor is assumed to coincide with the frame that "
                                      f"{self.resolve_topic_name(self.parameters['motion'])} reports on")
        self._describe(stream, stream.sketch_sensor)
        self.diagnostics.frame_id = sensor.frame_id
        self.diagnostics.show(**stream.facts)
        self.release_frames()

    def _look_at(self, photons: PhotonFrame, sensor: SensorModel) -> None:
        """Leave out hot pixels once they are known, and warn of photons that look wrong."""
        self._watch = self._watch or LightWatch(sensor)
        if self._watch.look(photons, self._now_s()):
            self.diagnostics.show(hot_pixels=int(self._watch.hot.sum()))
            self.apply_parameters()
        if self._watch.warning:
            self.diagnostics.warn(self._watch.warning)

    # ---- Packets in, sketches out

    def _on_packet(self, codec: Codec, raw: bytes) -> None:
        if self._refused and self._file is not None and self.count_publishers(self._topic) <= 1:
            self._use_file(f"{self._topic} has no other publisher any more")
        stream = self._stream
        if stream is None:
            raise Dropped("no_sensor", self.diagnostics.problem or "no description of the sensor has arrived")
        header, photons = codec.decode_cdr(raw, stream.sensor)
        self._frame_id = header.frame_id or stream.sensor.frame_id
        if self._motion is not None:
            self._motion.read_into(stream.add_motion)
        self._publish(stream, stream.push(photons, self._now_s()))
        self._look_at(photons, stream.sensor)

    def _on_motion(self) -> None:
        """Have the worker poll if frames wait for motion; called in the executor's thread."""
        stream = self._stream           # the worker may replace it at any time
        if stream is not None and stream.waits_for_motion:
            self.worker.call(self._poll)

    def _poll(self) -> None:
        """Publish the frames that have ended, or need not wait longer, without another packet."""
        stream = self._stream
        if stream is not None:
            if self._motion is not None:
                self._motion.read_into(stream.add_motion)
            self._publish(stream, stream.poll(self._now_s()))

    def _now_s(self) -> float:
        return self.now_ns() * 1e-9

    def _publish(self, stream: SketchStream, sketches: list[PhaseSums]) -> None:
        """Publish sketches, each after the description that it names."""
        values = self.parameters
        for sketch in sketches:
            self._describe(stream, sketch.sensor)
            data = sketch_message.encode_cdr(sketch, values["frame_id"] or self._frame_id, values["layout"])
            self.publish_frame(self._sketches, data, sketch.stamp_ns)
        if sketches:
            self.worker.messages_per_frame = stream.packets_per_frame
            self.diagnostics.show(**stream.facts)
        self.diagnostics.show(packets_open=stream.frame.packets)
        if sketches and self._motion is not None:
            self._motion.judge(stream.warning and f"frames go on undeskewed: {stream.warning}",
                               "frames are deskewed again")
            stream.warning = ""

    def _describe(self, stream: SketchStream, sensor: SensorModel) -> None:
        """Publish a description on `sketch/sensor`, unless it is the last one published."""
        if self._described is None or not sensor.same_as(self._described):
            self._described = sensor
            self.publish(self._descriptions, sensor_message.encode_cdr(sensor))
            self.get_logger().info("sketches of {}: gate {gate}, frequencies {frequencies}".format(
                sensor_summary(sensor), **stream.facts))


main = partial(run, SketcherNode)
