"""player: a photon file or the simulator → `photons` or `gates`, with the latched `sensor`, at a rate."""

import math
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from itertools import count

from rclpy.publisher import Publisher

from srt3d_ros import datasets
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.interface import LOSSLESS, Interface
from srt3d_ros.nodes.parameters import Parameter, Parameters
from srt3d_ros.nodes.runtime import run

SIMULATOR = "simulator"
ANSWER_TIMEOUT_S = 10.0     # then unanswered frames are given up: whoever had them is gone
ACKNOWLEDGE_S = 5.0

PARAMETERS = (
    Parameter("input", SIMULATOR, "Photon file (.npz, or .mat as published), or the simulator's moving scene.",
              form="a path or simulator"),
    Parameter("output", "photons", "Topic and form to send in; gates suit small arrays with few photons a pixel.",
              choices=("photons", "gates")),
    Parameter("rate_hz", 10.0, "Frames a second; 0 with `lossless`: as fast as they are answered.", "Hz", 0, 10_000),
    Parameter("loop", True, "Send a file's frame again and again; the simulator never ends."),
    Parameter("frames", 0, "Frames to send, then exit; 0: no limit.", low=0, high=10**9),
    Parameter("duration_s", 0.0, "Time to send for, then exit; 0: no limit. Needs a rate.", "s", 0, 10**6),
    Parameter("wait_for_subscribers", 1, "Subscribers to wait for before the first frame.", low=0, high=1000),
    LOSSLESS,
    Parameter("in_flight", 4, "When lossless: frames sent that `points` may still have to answer; more than "
              "packets_per_frame × window_frames of the sketcher.", low=1, high=1000),
    Parameter("ppp", 15.0, "Simulator: mean photons a pixel and frame.", low=0, high=10**6),
    Parameter("sbr", 1.0, "Simulator: signal-to-background ratio.", low=1e-6, high=10**6),
    Parameter("seed", 0, "Simulator: the same seed gives the same photons.", low=0, high=10**9),
    Parameter("num_bins", 0, "File: T, where the file does not say.", "bins", 0, 65_535),
    Parameter("bin_width_s", 0.0, "File: bin width, where the file does not say.", "s", 0, 1),
    Parameter("irf", "", "File: path of the IRF (.npy or .npz), where the file has none.", form="a path"),
    Parameter("fov_deg", 0.0, "File: field of view of the larger side, where the file does not say.", "deg", 0, 179),
    Parameter("frame_id", "", "tf frame of the photons; that of the file or simulator if empty."),
)

INTERFACE = Interface(
    "player",
    purpose="Plays a photon file, or the simulator's moving scene, as a sensor's driver would, and ends by itself "
    "after the last frame.",
    inputs=(replace(topics.POINTS, when="`lossless`: they answer what was sent"),),
    outputs=(topics.SENSOR, replace(topics.PHOTONS, when="`output` is photons"),
             replace(topics.GATES, when="`output` is gates")),
    parameters=PARAMETERS,
    limits=("At a rate that the machine cannot keep, frames are late; none is skipped.",),
)


class PlayerNode(PipelineNode):
    """Sends frame k with the stamp first + k / rate_hz, at that time, and ends by itself after the last."""

    interface = INTERFACE

    def configure(self) -> None:
        """Open the input, describe the sensor."""
        rate_hz = self.parameters["rate_hz"]
        require(rate_hz > 0 or self.lossless, "rate_hz", rate_hz, "above 0 Hz, or lossless to send as fast as answered")
        require(rate_hz > 0 or not self.parameters["duration_s"], "rate_hz", rate_hz, "above 0 Hz with duration_s")
        sensor, self._frame, notes = open_input(self.parameters)
        for note in notes:
            self.get_logger().info(f"{self.parameters['input']}: {note}")
        if self.parameters["output"] == "gates" and sensor.gates is None:
            sensor = sensor.replace(gates=GateWords())
        if self.parameters["frame_id"]:
            sensor = sensor.replace(frame_id=self.parameters["frame_id"])
        self._sensor = sensor
        self._encoded: tuple[PhotonEvents, bytes] | None = None
        self._encode(self._frame(0), 0)     # what cannot be sent is refused before anybody waits for it
        self._unanswered: deque[int] = deque()
        self._sensor_publisher = self.advertise("sensor")
        self._sensor_publisher.publish(sensor_message.encode(sensor))
        self._total = self._frames_to_send()
        self._publisher = self.advertise(self.parameters["output"])

    def activate(self) -> None:
        """Begin to play."""
        if self.lossless:
            self._answers = self.listen("points", self._on_answer)
        self.worker.call(self._play)

    def _play(self) -> None:
        try:
            self._wait_for_listeners()
            self._send_all()
            self._wait_for_answers(0)
            self._wait_until_acknowledged(self._publisher)
        except Exception:
            self.exit_code = 1
            raise
        finally:
            if not self.halted.is_set():        # else the node was only deactivated
                self.finished.set()

    def _wait_for_listeners(self) -> None:
        wanted, publisher = self.parameters["wait_for_subscribers"], self._publisher
        self.wait_until(lambda: publisher.get_subscription_count() >= wanted,
                        f"{wanted} subscriber{'s' * (wanted > 1)} on {publisher.topic_name}")
        if self.lossless:
            self.wait_until(self._answers.get_publisher_count, f"somebody who publishes {self._answers.topic_name}")
        self._wait_until_acknowledged(self._sensor_publisher)

    def _wait_until_acknowledged(self, publisher: Publisher) -> None:
        self.wait_until(lambda: all_acknowledged(publisher), f"those who read {publisher.topic_name}", ACKNOWLEDGE_S)

    def _send_all(self) -> None:
        rate_hz = self.parameters["rate_hz"]
        started = first_ns = stamp_ns = 0
        for k in count():
            if k == self._total or self.halted.is_set():
                return
            frame = self._frame(k)
            self._wait_for_answers(self.parameters["in_flight"] - 1)
            if k == 0:
                started, first_ns = time.monotonic(), self.now_ns()
                self.diagnostics.show(first_stamp_ns=first_ns)
                stamp_ns = first_ns
            elif rate_hz:
                stamp_ns = first_ns + round(k * 1e9 / rate_hz)
            else:
                stamp_ns = max(stamp_ns + 1, self.now_ns())
            data = self._encode(frame, stamp_ns)
            if rate_hz and self.halted.wait(max(started + k / rate_hz - time.monotonic(), 0)):
                return
            if self.lossless:
                self._unanswered.append(stamp_ns)
            self.publish_frame(self._publisher, data, stamp_ns)
            self.diagnostics.count(frames_sent=1, photons_sent=frame.photons)

    def _frames_to_send(self) -> int | None:
        limits = []
        if self.parameters["input"] != SIMULATOR and not self.parameters["loop"]:
            limits.append(1)
        if self.parameters["frames"]:
            limits.append(self.parameters["frames"])
        if self.parameters["duration_s"]:
            limits.append(math.ceil(self.parameters["duration_s"] * self.parameters["rate_hz"]))
        return min(limits, default=None)

    def _encode(self, events: PhotonEvents, stamp_ns: int) -> bytes:
        """The message of a frame; that of a file, which is the same again and again, is written once."""
        if self._encoded is None or self._encoded[0] is not events:
            sensor = self._sensor
            if self.parameters["output"] == "gates":
                data = gates_message.encode_cdr(PhotonGates.from_events(events, sensor), sensor, sensor.frame_id)
            else:
                data = photons_message.encode_cdr(events, sensor, sensor.frame_id)
            self._encoded = events, data
        return cdr.restamp(self._encoded[1], stamp_ns)

    def _on_answer(self, raw: bytes) -> None:
        """A cloud answers its frame and, since the pipeline keeps the order, all before it."""
        try:
            stamp_ns = cdr.read_cloud(raw).header.stamp_ns
        except InvalidInput as error:
            self.diagnostics.error(f"{self._answers.topic_name}: {error}")
            return
        while self._unanswered and self._unanswered[0] <= stamp_ns:
            self._unanswered.popleft()

    def _wait_for_answers(self, allowed: int) -> None:
        """Wait until at most `allowed` frames are unanswered; give them up after a long silence."""
        while (waiting := len(self._unanswered)) > allowed and not self.halted.is_set():
            if not self.wait_until(lambda: len(self._unanswered) < waiting, f"answers on {self._answers.topic_name}",
                                   ANSWER_TIMEOUT_S) and not self.halted.is_set():
                self.diagnostics.count(unanswered=waiting)
                self.get_logger().warning(f"{waiting} frames were never answered on {self._answers.topic_name}")
                self._unanswered.clear()


def open_input(parameters: Parameters) -> tuple[SensorModel, Callable[[int], PhotonEvents], tuple[str, ...]]:
    """The sensor, a function that gives the photons of frame k, and what was assumed where a file does not say."""
    if parameters["input"] == SIMULATOR:
        simulator = Simulator(ppp=parameters["ppp"], sbr=parameters["sbr"], seed=parameters["seed"])
        return simulator.sensor, lambda k: simulator.frame(k)[0], ()
    overrides = {name: parameters[name] for name in ("num_bins", "bin_width_s", "irf", "fov_deg") if parameters[name]}
    photons = datasets.open_photons(parameters["input"], **overrides)
    return photons.sensor, lambda k: photons.frame, photons.notes


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run([PlayerNode], args)


if __name__ == "__main__":
    sys.exit(main())
