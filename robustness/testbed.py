"""Testbed: real nodes and a driver as processes, what a probe sees of them, and the frame counts over all restarts."""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes.pipeline_probe import PipelineProbe
from srt3d_ros.private_network import join_private_network
from srt3d_ros.processes import READY_TIMEOUT_S, Process, Processes

BALANCE_S = 20.0            # until all frames in transit have arrived and are reported; a node reports once a second
IN_TRANSIT = ("unaccounted_frames", "unaccounted_photons", "under_way", "photons_under_way")


class Testbed(Processes):
    """A context manager: the nodes run inside it, in a ROS domain of their own unless ROS_DOMAIN_ID is set.

    Args:
        nodes: parameters of each node to start, who listens before who speaks.
        folder: made anew, for what the driver sends and the nodes record.

    Attributes:
        replaced: processes that have a successor, or were removed, by name.
        latest: the newest diagnostics of each node.
    """

    def __init__(self, nodes: dict[str, dict], folder: Path):
        if "ROS_DOMAIN_ID" not in os.environ:
            join_private_network()
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self.folder = folder
        self.probe = PipelineProbe(keep_every=10**9)
        super().__init__(self.probe.spin_until)
        self.parameters = nodes
        self.replaced: list[tuple[str, Process]] = []
        self.latest: dict[str, dict[str, str]] = {}
        self._earlier: dict[str, Counter] = {}      # counts of the processes that a node had before

    def __enter__(self) -> "Testbed":
        self.probe.__enter__()
        try:
            for name, parameters in self.parameters.items():
                super().start(name, **parameters)
            for name in self.parameters:
                self.wait_ready(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc) -> None:
        self.stop()
        super().__exit__()
        self.probe.__exit__()

    def start(self, name: str, *ros_args: str, **parameters) -> Process:
        """Start a node or the driver, or start it again, and wait until it is ready."""
        if name == "driver":
            script = str(Path(__file__).with_name("driver.py"))
            return self.run(name, [sys.executable, script, str(self.folder / "sensors")], stdin=subprocess.PIPE).ready()
        super().start(name, *ros_args, **self.parameters.get(name, {}) | parameters)
        return self.wait_ready(name)

    def write_packets(self, name: str, sensor: SensorModel, frames: list[PhotonEvents]) -> None:
        """Write a sensor and the packets that the driver sends of it in turn."""
        folder = self.folder / "sensors" / name
        folder.mkdir(parents=True)
        (folder / "sensor.json").write_text(sensor_message.encode(sensor).data)
        for k, frame in enumerate(frames):
            (folder / f"{k:03}.cdr").write_bytes(photons_message.encode_cdr(frame, sensor, sensor.frame_id))

    def drive(self, **settings) -> Counter[str]:
        """Have the driver behave like this (see driver.py); what it did so far."""
        driver = self["driver"]
        before = len(driver.lines)
        driver.tell(json.dumps(settings))
        self.wait(lambda: len(driver.lines) > before or not driver.running, "an answer of the driver")
        return Counter(json.loads(driver.lines[-1]))

    def set(self, name: str, **values) -> None:
        """Set parameters of a node; AssertionError if it refuses."""
        client = self.probe.node.create_client(SetParametersAtomically, f"{name}/set_parameters_atomically")
        self.wait(client.service_is_ready, f"the parameters of {name}")
        given = [Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
        answer = client.call_async(SetParametersAtomically.Request(parameters=given))
        self.wait(answer.done, f"an answer of {name}")
        self.probe.node.destroy_client(client)
        assert answer.result().result.successful, answer.result().result.reason

    def run(self, name: str, command: list[str], **options) -> Process:
        if name in self:
            self.remove(name)
        return super().run(name, command, **options)

    def remove(self, name: str) -> None:
        """Forget a process that has ended; its counts stay in the totals."""
        self.spin(0.1)
        self.replaced.append((name, self.pop(name)))
        self._fold(name)
        self.probe.statuses.pop(name, None)

    def wait_ready(self, name: str) -> Process:
        """Wait until a node is ready; AssertionError if it ends instead."""
        process = self[name]
        self.wait(lambda: "ready" in process.text or not process.running, f"{name} to be ready", READY_TIMEOUT_S)
        assert process.running, f"{name} {process.ending}:\n{process.text}"
        return process

    def spin(self, seconds: float) -> None:
        """Receive for so long."""
        self.saw(lambda: False, seconds)

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = BALANCE_S) -> None:
        """Receive until the condition holds; TimeoutError names `what` never came."""
        if not self.saw(condition, timeout_s):
            raise TimeoutError(f"waited {timeout_s:.0f} s for {what}")

    def saw(self, condition: Callable[[], object], timeout_s: float) -> bool:
        """Receive until the condition holds or the time is over; whether it holds."""
        def update() -> bool:
            for name, values in self.probe.statuses.items():
                if int(values["frames_in"]) < int(self.latest.get(name, values)["frames_in"]):
                    self._fold(name)        # it counts from 0 again
                self.latest[name] = values
            return bool(condition())

        return self.probe.spin_until(update, timeout_s)

    def totals(self, name: str) -> Counter[str]:
        """The counts of a node since the beginning: frames_in, message_lost, dropped.CAUSE, …"""
        return self._earlier.get(name, Counter()) + _counts(self.latest.get(name, {}))

    def losses(self) -> Counter[str]:
        """Frames that were lost, by "node: cause"."""
        return Counter({f"{name}: {key.removeprefix('dropped.')}": number for name in {*self.latest, *self._earlier}
                        for key, number in self.totals(name).items()
                        if number and (key.startswith("dropped.") or key == "message_lost")})

    def unbalanced(self, names) -> dict[str, int]:
        """Frames and photons that these nodes' newest diagnostics do not account for, where there are any."""
        amounts = {name: sum(abs(int(values.get(key, 0))) for key in IN_TRANSIT) if values else -1
                   for name in names for values in [self.latest.get(name)]}
        return {name: amount for name, amount in amounts.items() if amount}

    def settle(self, names) -> dict[str, int]:
        """Wait, with nothing more coming in, until new diagnostics account for every frame; returns what they lack."""
        before = dict(self.probe.statuses)
        self.saw(lambda: all(self.probe.statuses.get(name) is not before.get(name) for name in names)
                 and not self.unbalanced(names), BALANCE_S)
        return self.unbalanced(names)

    def _fold(self, name: str) -> None:
        self._earlier[name] = self._earlier.get(name, Counter()) + _counts(self.latest.pop(name, {}))


def _counts(values: dict[str, str]) -> Counter[str]:
    return Counter({key: int(value) for key, value in values.items() if value.isdecimal()})
