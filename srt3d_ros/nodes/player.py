"""player: a photon file or the simulator → `photons`, and their sensor."""

import time
from dataclasses import replace
from functools import partial

from rclpy.publisher import Publisher

from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.messages import cdr
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.lifecycle import run
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.sources import PACKETS, open_source
from srt3d_ros.nodes.topics import NodeSpec

ACKNOWLEDGE_S = 5.0

PARAMETERS = (
    Parameter("input", SIMULATOR, "Photon file (docs/photon-file.md), whose frame is repeated, or the simulator's "
              "moving scene.", form="a path or simulator"),
    Parameter("sensor_file", "", "File: what it lacks of its sensor's description, and tf frame and lens: JSON as on "
              "`sensor`, or another photon file. If empty, the file is complete.",
              form="a path"),
    Parameter("rate_hz", 10.0, "Frames per second.", "Hz", 1e-3, 10_000),
    Parameter("frames", 0, "Exit after this number of frames; 0: no limit.", low=0, high=10**9),
    Parameter("ppp", 15.0, "Simulator: mean photons per pixel and frame.", low=0, high=10**6),
    Parameter("sbr", 1.0, "Simulator: signal-to-background ratio.", low=1e-6, high=10**6),
    Parameter("seed", 0, "Simulator: the same seed gives the same photons.", low=0, high=10**9),
    Parameter("motion", "off", "Simulator: how the sensor moves through a furnished room: like a person who walks. "
              f"A frame comes in {PACKETS} packets, and `odom` says where its body is.",
              choices=("off", *MOTIONS), loose=True),
)

SPEC = NodeSpec(
    "player",
    outputs=(topics.SENSOR, topics.PHOTONS, replace(topics.ODOM, when="`motion`")),
    parameters=PARAMETERS,
)


class PlayerNode(PipelineNode):
    """Sends each message when it is due, stamped with that time."""

    spec = SPEC

    def configure(self) -> None:
        self._source = open_source(self.parameters.as_dict())
        for note in self._source.notes:
            self.get_logger().info(f"{self.parameters['input']}: {note}")
        # Before the others, for best effort: whoever has the description has found what was advertised before it.
        self._others = {topic: self.advertise(topic) for topic in self._source.others}
        self._sensors = self.advertise("sensor")
        self._publisher = self.advertise("photons")

    def activate(self) -> None:
        self._sensors.publish(sensor_message.encode(self._source.sensor))
        self.worker.call(self._play)

    def _play(self) -> None:
        try:
            self.wait_until(self._publisher.get_subscription_count, f"a subscriber on {self._publisher.topic_name}")
            self._wait_until_acknowledged(self._sensors)
            self._send_all()
            self._wait_until_acknowledged(self._publisher)
        except Exception:
            self.exit_code = 1
            raise
        finally:
            if not self.halted.is_set():        # else the node was only deactivated
                self.finished.set()

    def _wait_until_acknowledged(self, publisher: Publisher) -> None:
        self.wait_until(lambda: all_acknowledged(publisher), f"those who read {publisher.topic_name}", ACKNOWLEDGE_S)

    def _send_all(self) -> None:
        begun = None
        for item in self._source.items():
            if begun is None:           # the first is ready
                begun, first_ns = time.monotonic(), self.now_ns()
            if self.halted.wait(max(begun + item.due_ns * 1e-9 - time.monotonic(), 0)):
                return
            stamp_ns = first_ns + item.stamp_ns
            data = cdr.restamp(item.raw, stamp_ns)
            if item.topic in self._others:
                self._others[item.topic].publish(data)
            else:
                self.get_logger().info(f"the first frame's stamp is {stamp_ns}", once=True)
                self.diagnostics.count(messages_in=1)
                self.publish_frame(self._publisher, data, stamp_ns)


main = partial(run, PlayerNode)
