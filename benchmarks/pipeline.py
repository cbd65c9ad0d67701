"""Nodes in processes of their own, fed by benchmarks/driver.py, and what is seen of them from outside."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from srt3d_ros.benchmark.ros import running
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.processes import Process

TICK_S = 1 / os.sysconf("SC_CLK_TCK")
LAST_MESSAGES_S = 1.5       # for the last clouds and the last diagnostics


@dataclass(frozen=True)
class DrivenPipeline:
    """Running nodes.

    Args:
        probe: a PipelineProbe.
        processes: of the nodes.
        folder: removed at the end; messages/ is what the driver sends.
    """

    probe: object
    processes: dict[str, Process]
    folder: Path

    def driver_command(self, phases: str) -> list[str]:
        """What sends the messages; `phases` as in driver.py."""
        return [sys.executable, str(Path(__file__).with_name("driver.py")), str(self.folder / "messages"), phases]

    def drive(self, phases: str, watch: Callable[[], None] = lambda: None) -> tuple[list[dict], dict[str, float]]:
        """Send, calling `watch` about ten times a second; the driver's phases, and the CPU of each process in %."""
        before = self._cpu_s()
        driver = Process(self.driver_command(phases))
        while driver.running:
            self.probe.spin_until(lambda: False, 0.1)
            watch()
        after = self._cpu_s()
        assert driver.code() == 0, driver.text
        result = json.loads(next(line for line in reversed(driver.lines) if line.startswith("{")))
        sent = result["phases"]
        sending_s = (sent[-1]["ended_ns"] - sent[0]["began_ns"]) * 1e-9
        used_s = {name: after[name] - before[name] for name in before} | {"driver": result["cpu_s"]}
        self.probe.spin_until(lambda: False, LAST_MESSAGES_S)
        return sent, {name: round(100 * seconds / sending_s, 1) for name, seconds in used_s.items()}

    def _cpu_s(self) -> dict[str, float]:
        return {name: cpu_s(process.pid) for name, process in self.processes.items()} | {"probe": time.process_time()}


@contextmanager
def driven_pipeline(nodes: dict[str, dict], write_messages: Callable[[Path], None]) -> Iterator[DrivenPipeline]:
    """Nodes with these parameters, ready, and messages for them, which `write_messages` writes to a folder."""
    with running(nodes) as (probe, processes, folder):
        (folder / "messages").mkdir()
        write_messages(folder / "messages")
        yield DrivenPipeline(probe, processes, folder)


def write_photons(folder: Path, sensor: SensorModel, frames: list[PhotonEvents | PhotonGates]) -> None:
    """Write photons or gates and their sensor for the driver."""
    (folder / "sensor.json").write_text(sensor_message.encode(sensor).data)
    for k, frame in enumerate(frames):
        topic, codec = ("gates", gates_message) if isinstance(frame, PhotonGates) else ("photons", photons_message)
        write_packet(folder, k, {topic: codec.encode_cdr(frame, sensor, sensor.frame_id)})


def write_packet(folder: Path, number: int, messages: dict[str, bytes]) -> None:
    """Write messages, by topic, that the driver sends together."""
    packet = folder / f"{number:03}"
    packet.mkdir()
    for topic, message in messages.items():
        (packet / f"{topic}.cdr").write_bytes(message)


def cpu_s(pid: int) -> float:
    """CPU time that a process and the processes under it have used, seconds; 0 once it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) * TICK_S + sum(cpu_s(int(child)) for child in children)


def losses(probe) -> dict[str, int]:
    """All counts of drops, losses and errors in the nodes' newest diagnostics, by NODE.KEY."""
    return {f"{node}.{key}": int(value) for node, values in probe.statuses.items() for key, value in values.items()
            if key.startswith("dropped") and not key.endswith("_per_s") or key in ("message_lost", "errors")}


def percentiles(latencies_ms) -> dict[str, float]:
    """p50, p95 and the largest, ms."""
    values = np.percentile(latencies_ms, [50, 95, 100]) if len(latencies_ms) else [np.nan] * 3
    return dict(zip(("p50", "p95", "max"), np.round(values, 1).tolist()))
