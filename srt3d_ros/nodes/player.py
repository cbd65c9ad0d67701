"""player: a photon file or the simulator → `photons` and `sensor`."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message

from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.errors import BAD_INPUT, InvalidInput, require
from srt3d_ros.messages import cdr, sensor_message
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.managed_node import QUEUE_DEPTH, ManagedNode
from srt3d_ros.nodes.common.parameters import Parameter
from srt3d_ros.nodes.common.peers import all_acknowledged
from srt3d_ros.nodes.common.process import run
from srt3d_ros.nodes.common.reports import Chain, Reports
from srt3d_ros.nodes.common.topics import NodeSpec
from srt3d_ros.nodes.sources import PACKETS, open_source
from srt3d_ros.processes.node_command import FRAMES_LOST

ACKNOWLEDGE_S = 5.0
POLL_S = 0.005
READY_S = 600.0         # timeout for the nodes of `wait_for`: on a busy machine, kernels compile for minutes
SETTLE_S = 30.0         # without progress, after which the last frames count as lost
SKIPPED_EVERY_S = 60.0      # at most, a line about skipped frames

PARAMETERS = (
    Parameter("input", SIMULATOR, "Photon file (docs/photon-file.md), whose frame is repeated, or the simulator's "
              "moving scene.", form="a path or simulator"),
    Parameter("sensor_file", "", "Photon file: sensor description for what the file leaves out, and for tf frame and "
              "lens: JSON as on `sensor`, or another photon file. If empty, the file must be complete.",
              form="a path"),
    Parameter("rate_hz", 10.0, "Frames per second.", "Hz", 1e-3, 10_000),
    Parameter("frames", 0, "Exit after this number of frames; 0: no limit.", low=0, high=10**9),
    Parameter("ppp", 15.0, "Simulator: mean photons per pixel and frame.", low=0, high=10**6),
    Parameter("sbr", 1.0, "Simulator: signal-to-background ratio.", low=1e-6, high=10**6),
    Parameter("cycles", 0, "Simulator: laser cycles per frame. The detector then records only the first photon of each "
              "cycle (pile-up); 0: it records all photons.", low=0, high=10**9),
    Parameter("seed", 0, "Simulator: the same seed gives the same photons.", low=0, high=10**9),
    Parameter("motion", "off", "Simulator: walk moves the sensor through a furnished room as a walking person would. "
              f"A frame then has {PACKETS} packets, and `odom` gives the pose of the body.",
              choices=("off", *MOTIONS)),
    Parameter("wait_for", "", "Nodes in the order in which frames pass them, such as sketcher reconstructor recorder: "
              f"begin when all are ready, within {READY_S:.0f} s; after `frames`, wait until they have finished; if "
              f"frames were lost, log how many and exit with {FRAMES_LOST}. If empty: begin when `photons` has a "
              "subscriber.", form="names of nodes"),
)

SPEC = NodeSpec(
    "player",
    inputs=(topics.DIAGNOSTICS,),
    outputs=(topics.SENSOR, topics.PHOTONS, replace(topics.ODOM, when="`motion`")),
    parameters=PARAMETERS,
)


class PlayerNode(ManagedNode):
    """Publishes each message when it is due; with `wait_for`, also reports which frames became clouds."""

    spec = SPEC

    def configure(self) -> None:
        self._source = open_source(self.parameters.as_dict(), self.parameters.changed())
        for note in self._source.notes:
            self.get_logger().info(f"{self.parameters['input']}: {note}")
        self.diagnostics.frame_id = self._source.sensor.frame_id
        self._outputs = {topic.name: self.endpoints.advertise(topic) for topic in self._source.topics}
        self._photons = self._outputs[topics.PHOTONS.name]
        self.diagnostics.output = self._photons.topic_name
        names = ", ".join(publisher.topic_name for publisher in self._outputs.values())
        self.get_logger().info(f"plays {self.parameters['input']} on {names}")

    def activate(self) -> None:
        names = [self.resolve_topic_name(name)[1:] for name in self.parameters["wait_for"].split()]
        chain = None
        if names:
            chain = Chain(names, reports := Reports())
            self.endpoints.subscribe(topics.DIAGNOSTICS,
                                     lambda raw, info: reports.add(deserialize_message(raw, DiagnosticArray)),
                                     QUEUE_DEPTH)
        self._outputs[topics.SENSOR.name].publish(sensor_message.encode_cdr(self._source.sensor))
        self.worker.call(self._play, chain)

    def _play(self, chain: Chain | None) -> None:
        try:
            self.diagnostics.wait_for("the frames to be drawn")
            self._source.prepare(self.stopping.is_set)
            if chain is not None:
                self._wait_for(chain)
            else:
                self._wait(lambda: "" if self._photons.get_subscription_count()
                           else f"a subscriber on {self._photons.topic_name}")
            self._wait_until_acknowledged(self._outputs[topics.SENSOR.name])
            sent = self._send_all()
            self._wait_until_acknowledged(self._photons)
            if chain is not None and not self.stopping.is_set():
                self._follow_last(chain, sent)
        except Exception as error:
            self.exit_code = BAD_INPUT if isinstance(error, InvalidInput) else 1
            raise
        finally:
            if not self.stopping.is_set():      # otherwise the node was only deactivated
                self.finished.set()

    def _wait(self, missing: Callable[[], str], timeout_s: float = float("inf")) -> str:
        """Wait in the worker until nothing is missing, and report what is; returns what was at the end."""
        end_s = time.monotonic() + timeout_s
        while (what := missing()) and time.monotonic() < end_s and not self.stopping.wait(POLL_S):
            self.diagnostics.wait_for(what)
        self.diagnostics.wait_for("")
        return what

    def _wait_until_acknowledged(self, publisher: Publisher) -> None:
        readers = f"the readers of {publisher.topic_name}"
        self._wait(lambda: "" if all_acknowledged(publisher) else readers, ACKNOWLEDGE_S)

    def _wait_for(self, chain: Chain) -> None:
        """Wait until the nodes of `wait_for` are ready; InvalidInput if they are not within READY_S."""
        missing = self._wait(lambda: chain.missing(self.diagnostics.readers()), READY_S)
        if not self.stopping.is_set():
            require(not missing, "wait_for",
                    problem=f"Nodes of wait_for were not ready within {READY_S:.0f} s: {missing}")
            chain.begin()

    def _follow_last(self, chain: Chain, sent: int) -> None:
        """Wait until every frame has become a cloud, or none has for SETTLE_S, and log how many were lost."""
        outcome, since_s = chain.outcome(sent), time.monotonic()

        def unsettled() -> str:
            nonlocal outcome, since_s
            if (now := chain.outcome(sent)) != outcome:
                outcome, since_s = now, time.monotonic()
            return "the last frames" if outcome.under_way > 0 and time.monotonic() - since_s <= SETTLE_S else ""

        self._wait(unsettled)
        if outcome.missing > 0:
            self.exit_code = FRAMES_LOST
            self.get_logger().error(f"sent {sent}, of which {outcome.missing} were lost: {outcome.clouds} clouds; "
                                    "/diagnostics has the drops of each node by cause")
        else:
            self.get_logger().info(f"sent {sent}, none lost: {outcome.clouds} clouds")

    def _send_all(self) -> int:
        """Publish the source's messages when they are due; returns the number of frames."""
        begun_s = first_ns = sent = skipped = 0
        for item in self._source.items(lambda: round((time.monotonic() - begun_s) * 1e9) if begun_s else 0):
            if not begun_s:             # the clock starts when the first message is ready
                begun_s, first_ns = time.monotonic(), self.now_ns()
            wait_s = begun_s + item.due_ns * 1e-9 - time.monotonic()
            if self.stopping.wait(min(max(wait_s, 0), threading.TIMEOUT_MAX)):
                return sent
            if item.skipped:
                skipped += item.skipped
                late = f"late: skipped {skipped} frames so far; use a lower rate_hz on this machine"
                self.diagnostics.count(skipped=item.skipped)
                self.diagnostics.warn(late)
                self.get_logger().warning(late, throttle_duration_sec=SKIPPED_EVERY_S)
            data, publisher = cdr.restamp(item.raw, first_ns + item.stamp_ns), self._outputs[item.topic]
            if publisher is not self._photons:
                publisher.publish(data)
                continue
            if not sent:
                self.get_logger().info(f"first stamp: {first_ns + item.stamp_ns} ns")
            self.diagnostics.count(messages_in=1)
            self.publish_frame(publisher, data, first_ns + item.due_ns)
            sent += 1
        self.get_logger().info(f"sent all of {self.parameters['input']}")
        return sent


main = partial(run, PlayerNode)
