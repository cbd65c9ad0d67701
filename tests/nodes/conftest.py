"""Real nodes in real processes, and a node in the test's own process that talks with them."""

import contextlib
import itertools
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.messages import photon_frames, sensor_message
from srt3d_ros.processes.node_command import parameter_arguments
from tests.nodes.eager_node import EagerNode
from tools.processes import Process, wait

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ASK_AGAIN_S = 1.0       # a question whose answer may have been lost
namespaces = itertools.count()


class Graph:
    """A namespace with nodes in it, and the test's own node, which spins in a thread.

    Args:
        namespace: a new one unless given; "/" is that of commands which name none.
    """

    def __init__(self, namespace: str = ""):
        self.namespace = namespace or f"/test{next(namespaces)}_{os.getpid()}"
        self.node = rclpy.create_node("tester", namespace=self.namespace)
        self.processes: list[Process] = []
        self._nodes: dict[str, Process] = {}        # the last of each name
        self._clients: dict[str, Client] = {}       # of services of nodes that have found them
        self._reports: dict[str, list] = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=100))
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._stop = False
        self._thread.start()

    def wait(self, condition: Callable[[], object], what: str):
        """The condition's value once it is true; or a failure with what the processes have written."""
        def describe() -> str:
            latest = [f"{name}: {reports[-1]}" for name, reports in self._reports.items()]
            return "\n".join([*latest, *(process.text for process in self.processes)])

        return wait(condition, what, describe)

    def start(self, name: str, *ros_args: str, code: str = "", **parameters) -> EagerNode:
        """Start a node in a process that first executes `code`; parameters as in `-p name:=value`."""
        arguments = [name, *parameter_arguments(parameters), "-r", f"__ns:={self.namespace}", *ros_args]
        self._clients.clear()
        self.processes.append(EagerNode(arguments, code))
        renamed = [arg.removeprefix("__node:=") for arg in ros_args if arg.startswith("__node:=")]
        self._nodes[renamed[0] if renamed else name] = self.processes[-1]
        return self.processes[-1]

    def collect(self, message_type: type, topic: str, depth: int = 1000, raw: bool = False) -> list:
        """The list into which the messages on a topic go from now on."""
        messages: list = []
        self.node.create_subscription(message_type, topic, messages.append, QoSProfile(depth=depth), raw=raw)
        return messages

    def collect_latched(self, message_type: type, topic: str) -> list:
        messages: list = []
        self.node.create_subscription(message_type, topic, messages.append, LATCHED)
        return messages

    def publisher(self, message_type: type, topic: str):
        return self.node.create_publisher(message_type, topic, QoSProfile(depth=100))

    def latched(self, topic: str, message_type: type = String):
        """A publisher of whose messages a late subscriber gets the last one, such as descriptions."""
        return self.node.create_publisher(message_type, topic, LATCHED)

    def set(self, name: str, **values) -> str:
        """Set parameters of a node together, as `ros2 param set` does one; why not, or an empty text."""
        given = [Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
        request = SetParametersAtomically.Request(parameters=given)
        result = self.call(SetParametersAtomically, f"{name}/set_parameters_atomically", request).result
        assert result.successful == (not result.reason)
        return result.reason

    def change(self, name: str, step: str) -> bool:
        """Ask a node for a transition, such as "activate", as a manager does; whether it went."""
        return self.call(ChangeState, f"{name}/change_state",
                         ChangeState.Request(transition=Transition(label=step))).success

    def call(self, service_type: type, service: str, request):
        """The answer of a service."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(service_type, service)
            self.wait(self._clients[service].service_is_ready, f"the service {service}")
            self.known_to(service.partition("/")[0])
        future = self._clients[service].call_async(request)
        self.wait(future.done, f"an answer from {service}")
        return future.result()

    def known_to(self, name: str) -> None:
        """Return once a node has found all that the test's node has made so far.

        An answer waits no more than 0.1 s for a client that its server has not found, and is lost then. Clients are
        found in the order in which they were made: who answers the newest, to what may be asked twice, has found all.
        """
        client = self.node.create_client(ListParameters, f"{name}/list_parameters")
        self.wait(client.service_is_ready, f"the parameters of {name}")
        began, answers = time.monotonic(), []

        def answered() -> bool:
            if time.monotonic() >= began + len(answers) * ASK_AGAIN_S:
                answers.append(client.call_async(ListParameters.Request()))
            return any(answer.done() for answer in answers)

        self.wait(answered, f"{name} to find its clients")
        self.node.destroy_client(client)

    def introduce(self, sensor: SensorModel) -> None:
        """Publish `sensor`, as a driver does when it starts, and wait until the sketcher uses it, wherever it sits."""
        described = self.collect_latched(String, "sketch/sensor")
        self.latched("sensor").publish(sensor_message.encode_cdr(sensor))
        self.wait(lambda: any(sensor_message.from_json(one.data).replace(extrinsics=sensor.extrinsics).same_as(sensor)
                              for one in described), "sketch/sensor")

    def matched(self, publisher, subscribers: int = 1):
        """The publisher, once it has its subscribers."""
        self.wait(lambda: publisher.get_subscription_count() >= subscribers, f"subscribers of {publisher.topic_name}")
        return publisher

    def report(self, name: str) -> dict[str, str]:
        """The newest diagnostics of a node, {} before the first; "level" and "message" beside its values."""
        reports = self.all_reports(name)
        return reports[-1] if reports else {}

    def total(self, name: str, key: str) -> int:
        """A count in the newest diagnostics of a node, 0 where there is none."""
        return int(self.report(name).get(key, 0))

    def all_reports(self, name: str) -> list[dict[str, str]]:
        return self._reports.get(f"{self.namespace}/{name}".lstrip("/"), [])

    def next_reports(self, name: str, number: int) -> list[dict[str, str]]:
        """Wait for so many more reports of a node."""
        before = len(self.all_reports(name))
        self.wait(lambda: len(self.all_reports(name)) >= before + number, f"{number} more reports of {name}")
        return self.all_reports(name)[before:]

    def reports(self, name: str, key: str, value) -> dict[str, str]:
        """Wait until a node's diagnostics show this value."""
        self.wait(lambda: self.report(name).get(key) == str(value), f"{key} = {value} in the diagnostics of {name}")
        return self.report(name)

    def close(self) -> None:
        """End the nodes; what came into each was published or dropped, by its last report."""
        for process in self.processes:
            process.send(signal.SIGTERM)
        for process in self.processes:
            process.stop()
        ended = [name for name, process in self._nodes.items() if self.report(name) and not process.killed]
        try:
            for name in ended:
                self.reports(name, "state", "finalized")
        finally:
            self._leave()
        for name in ended:
            for key, amount in under_way(self.report(name)).items():
                assert amount == "0", f"{name}: {key} is {amount}: {self.report(name)}"

    def _leave(self) -> None:
        self._stop = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()

    def _spin(self) -> None:
        """Spin; a test may destroy what rclpy is about to wait for."""
        while not self._stop:
            with contextlib.suppress(rclpy_implementation.InvalidHandle):
                self._executor.spin_once(timeout_sec=0.1)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            values |= {"level": status.level, "message": status.message, "hardware_id": status.hardware_id,
                       **under_way(values)}
            self._reports.setdefault(status.name, []).append(values)


def under_way(report: dict[str, str]) -> dict[str, str]:
    """Frames (in a sketcher, packets) and photons that came into a node and were neither published nor dropped yet."""
    out = "packets" if "packets" in report else "frames_out"
    counters = {"under_way": ("messages_in", out, "dropped"),
                "photons_under_way": ("photons_in", "photons", "photons_dropped")}
    return {key: str(int(report[came]) - int(report.get(went, 0)) - int(report[dropped]))
            for key, (came, went, dropped) in counters.items() if came in report}


@pytest.fixture
def graph(ros):
    """An empty graph; whatever is started in it is ended with the test, and has lost no frame then."""
    graph = Graph()
    yield graph
    graph.close()


@pytest.fixture(scope="module")
def shared_graph(ros):
    """A graph for all the tests of a file."""
    graph = Graph()
    yield graph
    graph.close()


@pytest.fixture(scope="session")
def sensor() -> SensorModel:
    """A small sensor: 16 × 12 pixels, T = 100."""
    irf = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / 4)
    return SensorModel(rows=16, cols=12, num_bins=100, bin_width_s=1e-10, irf=irf, gates=GateWords(), frame_id="spad")


@pytest.fixture(scope="session")
def events(sensor) -> PhotonEvents:
    """40 photons a pixel of a plane at bin 50, half of them background; sorted."""
    rng = np.random.default_rng(1)
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 40)
    toa = np.where(rng.random(len(pixel)) < 0.5, rng.integers(0, sensor.num_bins, len(pixel)),
                   np.clip(np.round(rng.normal(50, 2, len(pixel))), 0, sensor.num_bins - 1))
    return PhotonEvents(pixel, toa.astype(np.uint16), stamp_ns=1_000_000_000)


@pytest.fixture(scope="session")
def photons_at(events, sensor) -> Callable[[int], bytes]:
    """Makes the message of the events, acquired at a stamp [ns]."""
    return lambda stamp_ns: photon_frames.PHOTONS.encode_cdr(replace(events, stamp_ns=stamp_ns), sensor, "spad")


@pytest.fixture(scope="session")
def photon_file(sensor, events, tmp_path_factory) -> Path:
    """The same photons as an npz file."""
    path = tmp_path_factory.mktemp("photons") / "plane.npz"
    np.savez(path, rows=sensor.rows, cols=sensor.cols, num_bins=sensor.num_bins, bin_width_s=sensor.bin_width_s,
             pixel=events.pixel, toa=events.toa, irf=sensor.irf, irf_ref=sensor.irf_ref)
    return path
