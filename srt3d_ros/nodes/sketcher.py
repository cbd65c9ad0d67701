"""sketcher: `photons`, `gates` or `histograms` → `sketch`. Keeps m complex numbers a pixel instead of the photons."""

from functools import partial

from rclpy.timer import Timer
from std_msgs.msg import String

from srt3d_ros.core import precompile
from srt3d_ros.core.framing import Framing, OpenFrame
from srt3d_ros.core.gate import OFF
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketch_design import SketchDesign
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode
from srt3d_ros.nodes.parameters import Value
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.sensor_choice import SensorChoice
from srt3d_ros.nodes.sketch_output import SketchOutput
from srt3d_ros.nodes.sketcher_parameters import SPEC, AnySketcher, design_settings, make_sketcher
from srt3d_ros.nodes.waiting_frames import WaitingFrames
from srt3d_ros.nodes.worker import Dropped

CHECK_SILENCE_S = 0.05
LIKELY_PACKETS = 8          # of a period, before the first has ended


class SketcherNode(PipelineNode):
    """Follows `sensor`, also when it changes, and publishes `sketch/sensor` and a `sketch` a frame.

    Every packet and photon that came in waits, alone or in an ended frame, is in a published frame or in the open one,
    or was dropped for a cause.
    """

    spec = SPEC
    _sensor: SensorModel | None = None
    _design: SketchDesign | None = None         # gate and frequencies, which may follow the photons
    _sketcher: AnySketcher | None = None        # None while photons cannot be used
    _waiting: WaitingFrames | None = None       # frames that ended, with motion
    _framing: Framing | None = None             # which counts the open frame; None before the first activation
    _silence: Timer | None = None

    def configure(self) -> None:
        self._choice = SensorChoice(self)
        self._check(self.parameters.as_dict())
        precompile.sketching()
        if self.parameters["motion"] != OFF:
            precompile.deskewing()
        if self._choice.file is not None:
            self._file_publisher = self.advertise("sensor")
            self.diagnostics.find_contradiction = self._contradiction
        self._output = SketchOutput(self)
        self.serve("reset", self._reset)
        self.parameters.on_check = self._check
        self.parameters.on_change = self._on_change

    def activate(self) -> None:
        self._framing = self._make_framing()
        self.worker.messages_per_frame = max(self.parameters["packets_per_frame"],
                                             LIKELY_PACKETS if self.parameters["frame_period_s"] else 1)
        self._frame_id, self._last_packet_ns = "", 0
        self._own_description = ""      # as published on `sensor`, from where it comes back
        if self.parameters["motion"] != OFF:
            self._waiting = WaitingFrames(self, self.failed)
        self._choice.begin()
        if self._choice.file is None:
            self.hold_frames_for("a sensor description on sensor")
        else:
            writer = f"{self.get_fully_qualified_name()} {self.now_ns()}"   # a driver's may say the same
            message = sensor_message.encode(self._choice.file, x_writer=writer)
            self._file_publisher.publish(message)
            self._own_description = message.data
            self.worker.call(self._update_sensor)
        self.follow("sensor", self._on_sensor)
        for topic, codec in CODECS.items():
            self.subscribe(topic, partial(self._on_packet, codec), getattr(codec, "announced", lambda raw: 0))
        self._start_silence_timer()

    def deactivate(self) -> None:
        super().deactivate()
        self.destroy_timer(self._silence)
        self._silence = None
        self._choice.forget()
        self._sensor = self._design = self._sketcher = self._waiting = None

    def forget(self) -> None:
        """Begin a new frame and a new window."""
        self._drop_incomplete(self._framing.clear())

    def _reset(self) -> str:
        self.forget()
        return "a new frame begins"

    def _on_change(self) -> None:
        if self.state == "active":
            self._start_silence_timer()
            self.worker.call(self._apply)

    def _start_silence_timer(self) -> None:
        if self.parameters["frame_period_s"] and self._silence is None:     # else it would cost 1 % of a core
            self._silence = self.create_timer(CHECK_SILENCE_S, self._end_if_silent)

    def _on_sensor(self, message: String) -> None:
        if message.data == self._own_description:
            return
        described = sensor_message.decode(message)
        if self._choice.file is None:
            if self._choice.replace(described):
                self.drop_older()
            self._update_sensor()
        elif problem := self._choice.compare(described):
            self.forget()       # photons of the other sensor may be among those of the open frame
            raise problem

    def _contradiction(self) -> str:
        """How `sensor` contradicts sensor_file, while another node publishes `sensor`."""
        topic = self._file_publisher.topic_name
        if self._choice.contradiction and self.count_publishers(topic) <= 1:
            self._choice.agree(f"nobody else publishes {topic} any more")
        return self._choice.contradiction

    def _update_sensor(self) -> None:
        """Use the sensor in force."""
        self._sensor = self._choice.sensor
        self._apply()

    def _apply(self) -> None:
        """Apply sensor and parameters from now on. The frame and the window go on unless they change."""
        values, framing = self.parameters.as_dict(), self._make_framing()
        if framing.settings != self._framing.settings:
            self.forget()
            self._framing = framing
        if self._sensor is None:
            return
        before, self._sketcher = self._sketcher, None       # None if what follows fails
        try:
            if self._design is None or not self._design.is_for(self._sensor, *design_settings(values)):
                self._design = SketchDesign(self._sensor, *design_settings(values))
            self._design.window_frames = values["window_frames"]
        except InvalidInput:
            self.forget()
            raise
        if before is None or not self._design.made(before):
            self.forget()
            self._sketch_by_design()
        else:
            self._sketcher = before
            if values["window_frames"] == before.window_frames:
                return
            before.resize(values["window_frames"])
        self._output.describe(self._sketcher)

    def _sketch_by_design(self) -> None:
        """Begin a new window with the gate and the frequencies in force."""
        self._sketcher = make_sketcher(self._sensor, self._design, self.parameters.as_dict())

    def _check(self, values: dict[str, Value]) -> None:
        """Refuse parameters with which the present sensor, or any, cannot be sketched."""
        sensor = self._sensor or self._choice.file or precompile.ANY_SENSOR
        make_sketcher(sensor, SketchDesign(sensor, *design_settings(values)), values)

    def _make_framing(self) -> Framing:
        return Framing(self.parameters["packets_per_frame"], round(self.parameters["frame_period_s"] * 1e9))

    # ---- Packets

    def _on_packet(self, codec, raw: bytes) -> None:
        self._last_packet_ns = self.now_ns()
        if self._choice.contradiction:
            raise Dropped("contradiction", self._choice.contradiction)
        if self._sketcher is None:
            raise Dropped("no_sensor", "there is no description of the sensor that can be used")
        header, photons = codec.decode_cdr(raw, self._sketcher.sensor)
        placed = self._framing.place(header.stamp_ns, raw)
        self._end_frame(placed.ended)
        if placed.began_again:
            self.get_logger().info("stamps leapt: new frame, new window", throttle_duration_sec=LOG_EVERY_S)
            self._drop_incomplete(placed.forgotten)
        if not placed.dropped:
            self._sketcher.add(photons)
            self._design.look(photons)
        if not hasattr(codec, "announced"):     # the message's header does not say how many
            self.diagnostics.count(photons_in=photons.photons)
        if placed.dropped:
            self.diagnostics.drop(placed.dropped, photons=photons.photons)
            return
        self._frame_id = header.frame_id
        self._end_frame(self._framing.add(header.stamp_ns, photons.photons))
        self._show_open_frame()

    def _end_if_silent(self) -> None:
        if self._framing.open.packets and self._is_silent():
            self.worker.call(self._end_after_silence)

    def _is_silent(self) -> bool:
        return self.now_ns() - self._last_packet_ns > self._framing.silence_ns

    def _end_after_silence(self) -> None:
        if self._is_silent():
            self._end_frame(self._framing.end_after_silence())

    def _end_frame(self, frame: OpenFrame | None) -> None:
        """Publish a frame that has ended, if there is one. If that fails, its packets are dropped."""
        if frame is None:
            return
        self.worker.messages_per_frame = frame.packets
        sketcher = self._sketcher
        try:
            kept = frame.photons if sketcher.gate is None else min(sketcher.kept, frame.photons)
            publish = partial(self._publish, frame, kept, sketcher, self._frame_id, self._design.in_words)
            ended = sketcher.end_frame()
            if self._waiting is None:
                publish(ended)
            else:
                self._waiting.add(frame, ended, sketcher, publish)
        except Exception as error:
            self.failed(error, *frame)
            self._sketcher.reset()
            self._design.forget()
        else:
            self._follow_photons(ended.to_ns if self._waiting else ended.stamp_ns)
        self._show_open_frame()

    def _publish(self, frame: OpenFrame, kept: int, sketcher: AnySketcher, frame_id: str, design: str, sketch: Sketch,
                 lost: int = 0) -> None:
        """Publish the sketch of a frame, which kept so many of its photons and lost so many of these by the motion."""
        lost = min(lost, kept)
        self._output.publish(sketch, frame_id, sketcher, design, frame.packets, kept - lost)
        self.diagnostics.drop("gate", frames=0, photons=frame.photons - kept)
        self.diagnostics.drop("out_of_view", frames=0, photons=lost)

    def _follow_photons(self, stamp_ns: int) -> None:
        """Go on with another gate or other frequencies if the photons ask for it."""
        try:
            if self._design.end_frame(stamp_ns):
                self._sketch_by_design()
        except InvalidInput as problem:
            self.failed(problem)       # a window that is too large with a gate: go on as before
        self.diagnostics.show(**self._design.light_in_words)

    def _drop_incomplete(self, frame: OpenFrame | None) -> None:
        """Drop a frame that did not end, if there is one, and begin a new window after the frames that did."""
        if self._waiting is not None:
            self._waiting.flush()
        self._output.flush()
        if frame is not None:
            self.diagnostics.drop("incomplete", *frame)
        if self._sketcher is not None:
            self._sketcher.reset()
            self._design.forget()
        self._show_open_frame()

    def _show_open_frame(self) -> None:
        self.diagnostics.show(packets_open=self._framing.open.packets)


main = partial(run, SketcherNode)
