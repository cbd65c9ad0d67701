"""device: the stream or log of a histogramming sensor → `histograms`, with the latched `sensor`."""

import threading
import time
from functools import partial

from srt3d_ros import devices
from srt3d_ros.core.photons import PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.devices.publisher import CONNECTED, GONE, Subscription
from srt3d_ros.devices.reading import Steady
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import histograms as histograms_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.worker import Dropped

POLL_S = 0.1            # longest time until a halt is seen
ACKNOWLEDGE_S = 5.0

PARAMETERS = (
    Parameter("device", "tmf8829", "The sensor model; see docs/devices.md.", choices=tuple(devices.DEVICES)),
    Parameter("connect", "", "Address of the sensor's ZeroMQ publisher (tmf8829).", form="such as tcp://HOST:5558"),
    Parameter("log", "", "Without `connect`: a log of the sensor, played once.", form="a path"),
    Parameter("rate_hz", 10.0, "Log: frames per second.", "Hz", 0.01, 1000),
    Parameter("frame_id", "", "tf frame of the histograms; if empty, the device's name."),
)

SPEC = NodeSpec(
    "device",
    outputs=(topics.SENSOR, topics.HISTOGRAMS),
    parameters=PARAMETERS,
)


class DeviceNode(PipelineNode):
    """Receives in a thread of its own; the worker decodes and publishes."""

    spec = SPEC

    def configure(self) -> None:
        """Find the device, or read the beginning of its log."""
        given, self._device = self.parameters.as_dict(), devices.DEVICES[self.parameters["device"]]
        self._address, self._log = given["connect"], given["log"]
        require(bool(self._address) != bool(self._log), "connect", self._address, "an address, or else a log")
        if self._address:
            readers = ", ".join(name for name, device in devices.DEVICES.items() if device.decode)
            require(self._device.decode is not None, "connect", self._address,
                    f"nothing: {given['device']} is read from logs only; streams are read from {readers}")
            Subscription(self._address).close()
        else:
            for note in next(devices.frames(self._log, self._device)).notes:
                self.get_logger().info(f"{self._log}: {note}")
        self._steady, self._described, self._receiver = Steady(), None, None
        self._sensors, self._publisher = self.advertise("sensor"), self.advertise("histograms")

    def activate(self) -> None:
        receive = self._follow if self._address else self._play
        self._receiver = threading.Thread(target=receive, name="receiver", daemon=True)
        self._receiver.start()

    def stop_frames(self, cause: str) -> None:
        """Receive no more, then as all nodes."""
        self.halted.set()
        if getattr(self, "_receiver", None) is not None:
            self._receiver.join()
        super().stop_frames(cause)

    def _follow(self) -> None:
        """Offer the messages of a publisher to the worker, and report when it comes and goes."""
        stream, address = Subscription(self._address), self._address
        self.diagnostics.waiting_for = address
        try:
            while not self.halted.is_set():
                came = stream.next(POLL_S)
                if came == CONNECTED:
                    self.diagnostics.waiting_for = f"a measurement of {address}"
                    self.diagnostics.count(connections=1)
                    self.get_logger().info(f"{address} is connected")
                elif came == GONE:
                    self.diagnostics.waiting_for = f"{address}, which is gone"
                    self.diagnostics.count(disconnections=1)
                    self.get_logger().warning(f"{address} is gone: waiting for it")
                elif came is not None:
                    self.diagnostics.waiting_for = ""
                    self._offer(self._decode, came, self.now_ns())
        finally:
            stream.close()

    def _play(self) -> None:
        """Offer the frames of a log to the worker when they are due, once there is a subscriber."""
        try:
            self.wait_until(self._publisher.get_subscription_count, f"a subscriber on {self._publisher.topic_name}")
            began = time.monotonic()
            for k, photons in enumerate(devices.frames(self._log, self._device)):
                if self.halted.wait(max(began + k / self.parameters["rate_hz"] - time.monotonic(), 0)):
                    return
                self._offer(self._publish, photons.sensor, photons.frame.counts, self.now_ns())
                self.wait_until(lambda: not self.worker.waiting[0], "the worker")
            self.worker.finish(self.finish_s)
            self.wait_until(lambda: all_acknowledged(self._publisher), "the subscribers", ACKNOWLEDGE_S)
            self.finished.set()
        except InvalidInput as error:
            self.exit_code = 1
            self.failed(error)
            self.finished.set()

    def _offer(self, work, *args) -> None:
        with self.worker.lock:
            self.diagnostics.received()
            self.worker.offer(work, *args)

    def _decode(self, message: bytes, stamp_ns: int) -> None:
        reading = self._device.decode(message, stamp_ns)
        if reading is None:
            raise Dropped("no_histograms", "the device sends results only: set histograms to 1 in its configuration")
        self._publish(reading.sensor, reading.frame.counts, stamp_ns)

    def _publish(self, sensor: SensorModel, counts, stamp_ns: int) -> None:
        """Publish a frame, and before it the description if that is another one."""
        if self.parameters["frame_id"]:
            sensor = sensor.replace(frame_id=self.parameters["frame_id"])
        sensor = self._steady.sensor(sensor)
        if sensor is not self._described:
            self._sensors.publish(sensor_message.encode_cdr(sensor))
            self._described = sensor
        frame = PhotonHistograms(counts, stamp_ns)
        self.publish_frame(self._publisher, histograms_message.encode_cdr(frame, sensor, sensor.frame_id), stamp_ns,
                           frames_sent=1, photons_sent=frame.photons)


main = partial(run, DeviceNode)
