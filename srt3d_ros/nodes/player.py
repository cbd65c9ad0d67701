"""player: a photon file, the simulator or a bag → `photons`, `gates`, `histograms` or `sketch`, and their sensor."""

import time
from dataclasses import replace
from functools import partial

from rclpy.publisher import Publisher

from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.messages import cdr
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.lifecycle import run
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.sources import PACKETS, RATE_HZ, SIMULATOR, MovingSource, open_source
from srt3d_ros.nodes.topics import NodeSpec

ACKNOWLEDGE_S = 5.0

PARAMETERS = (
    Parameter("input", SIMULATOR, "Photon file (docs/photon-file.md), bag (its folder, .mcap or .db3 file), or "
              "the simulator's moving scene.", form="a path or simulator"),
    Parameter("sensor_file", "", "File: what it lacks of its sensor's description, and tf frame and lens: JSON as on "
              "`sensor`, or another photon file. If empty, the file is complete or has a sidecar (FILE.json).",
              form="a path"),
    Parameter("output", "photons", "File and simulator: topic to publish. gates suit small arrays with few photons "
              "per pixel, histograms few bins with many photons.", choices=tuple(CODECS)),
    Parameter("rate_hz", RATE_HZ, "File and simulator: frames per second.", "Hz", 1e-3, 10_000),
    Parameter("loop", True, "File: repeat its frame. The simulator never ends; a bag is played once."),
    Parameter("frames", 0, "Exit after this number of frames; 0: no limit.", low=0, high=10**9),
    Parameter("ppp", 15.0, "Simulator: mean photons per pixel and frame.", low=0, high=10**6),
    Parameter("sbr", 1.0, "Simulator: signal-to-background ratio.", low=1e-6, high=10**6),
    Parameter("seed", 0, "Simulator: the same seed gives the same photons.", low=0, high=10**9),
    Parameter("motion", "off", "Simulator: how the sensor moves through a furnished room: like a person, a drone, or a "
              f"robot that turns on the spot. A frame comes in {PACKETS} packets, and `odom` says where its body is.",
              choices=("off", *MOTIONS), loose=True),
)

SPEC = NodeSpec(
    "player",
    outputs=(topics.SENSOR,
             *(replace(one, when=f"`output` is {one.name}, or the bag has {one.name}") for one in topics.FRAMES),
             *(replace(topic, when="the bag has sketches and no photons")
               for topic in (topics.SKETCH_SENSOR, topics.SKETCH)),
             replace(topics.ODOM, when="`motion`, or the bag has a topic of its type, beside photons"),
             replace(topics.IMU, when="the bag has a topic of its type, beside photons")),
    parameters=PARAMETERS,
)


class PlayerNode(PipelineNode):
    """Sends messages when they are due: those of a bag as they were recorded, others stamped with that time."""

    spec = SPEC

    def configure(self) -> None:
        self._source = open_source(self.parameters.as_dict())
        for note in self._source.notes:
            self.get_logger().info(f"{self.parameters['input']}: {note}")
        # Before the others, for best effort: whoever has the description has found what was advertised before it.
        self._others = {topic: self.advertise(topic) for topic in self._source.others}
        self._sensors: Publisher | None = None
        if self._source.sensor is not None:
            self._sensors = self.advertise(self._source.describes)
        self._publisher = self.advertise(self._source.output)

    def activate(self) -> None:
        self._behind_ns = 0         # the time by the stamps' clock is so much earlier: a recording's
        if self._sensors is not None:
            self._sensors.publish(self._source.sensor)
        self.worker.call(self._play)

    def cleanup(self) -> None:
        super().cleanup()
        self._source.close()

    def now_ns(self) -> int:
        """The time by the stamps' clock."""
        return super().now_ns() - self._behind_ns

    def _play(self) -> None:
        try:
            self.wait_until(self._publisher.get_subscription_count, f"a subscriber on {self._publisher.topic_name}")
            if self._sensors is not None:
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
        source, sent = self._source, 0
        total = None if isinstance(source, MovingSource) else self.parameters["frames"] or None
        begun = None
        for item in source.items():
            if begun is None:           # the first is ready
                begun, first_ns = time.monotonic(), super().now_ns()
                self._behind_ns = first_ns - source.recorded_ns if source.recorded_ns else 0
            if self.halted.wait(max(begun + item.due_ns * 1e-9 - time.monotonic(), 0)):
                return
            if item.topic == source.describes:
                self._sensors.publish(item.raw)
                self._wait_until_acknowledged(self._sensors)
                continue
            stamp_ns, data = item.stamp_ns, item.raw
            if not source.recorded_ns:
                stamp_ns += first_ns
                data = cdr.restamp(data, stamp_ns)
            if item.topic in self._others:
                self._others[item.topic].publish(data)
                continue
            if not sent:
                self.get_logger().info(f"the first frame's stamp is {stamp_ns}")
            self.diagnostics.count(messages_in=1)
            self.publish_frame(self._publisher, data, stamp_ns)
            sent += 1
            if sent == total:
                return


main = partial(run, PlayerNode)
