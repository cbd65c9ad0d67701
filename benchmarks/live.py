"""What the live benchmarks share: a pipeline of real processes, a driver that feeds it, what is seen from outside."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message

HERE = Path(__file__).resolve().parent
TICK_S = 1 / os.sysconf("SC_CLK_TCK")
READY_S, SETTLE_S = 180.0, 1.5


def write_messages(folder: Path, sensor: SensorModel, frames: list[PhotonEvents | PhotonGates]) -> str:
    """Write what benchmarks/driver.py sends; the topic."""
    (folder / "sensor.json").write_text(sensor_message.encode(sensor).data)
    of_gates = isinstance(frames[0], PhotonGates)
    for k, frame in enumerate(frames):
        codec = gates_message if of_gates else photons_message
        (folder / f"{k:03}.cdr").write_bytes(codec.encode_cdr(frame, sensor, sensor.frame_id))
    return "gates" if of_gates else "photons"


class Pipeline:
    """Sketcher and reconstructor in two processes, and a driver; a context manager that ends them.

    Args:
        monitor: an entered srt3d_ros.nodes.pipeline_probe.PipelineProbe.
        frames: packets that the driver sends in turn.
        parameters: of the sketcher.
    """

    def __init__(self, monitor, sensor: SensorModel, frames, **parameters):
        self.monitor = monitor
        self._folder = tempfile.TemporaryDirectory(prefix="srt3d-live-")
        self._topic = write_messages(Path(self._folder.name), sensor, frames)
        self._processes: dict[str, subprocess.Popen] = {}
        given = [part for name, value in parameters.items() for part in ("-p", f"sketcher:{name}:={value}")]
        self._start("reconstructor", "-m", "srt3d_ros.nodes.reconstructor")
        self._start("sketcher", "-m", "srt3d_ros.nodes.sketcher", "--ros-args", *given)

    def __enter__(self) -> "Pipeline":
        if not self.monitor.spin_until(lambda: {"sketcher", "reconstructor"} <= self.monitor.statuses.keys(), READY_S):
            self.__exit__()
            raise SystemExit("the nodes were not ready")
        return self

    def __exit__(self, *exc) -> None:
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            process.wait(20)
        self._folder.cleanup()

    def drive(self, phases: str, watch=lambda: None) -> tuple[dict, dict[str, float]]:
        """Send, with a `watch` about ten times a second; what the driver said, and the CPU of each process in %."""
        before = self._cpu_s()
        command = [sys.executable, str(HERE / "driver.py"), self._folder.name, self._topic, phases]
        driver = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        while driver.poll() is None:
            self.monitor.spin_until(lambda: False, 0.1)
            watch()
        after = self._cpu_s()
        said = json.loads(driver.stdout.read().splitlines()[-1])
        sending_s = (said["phases"][-1]["ended_ns"] - said["phases"][0]["began_ns"]) * 1e-9
        share = {name: round(100 * (after[name] - before[name]) / sending_s, 1) for name in before}
        share["driver"] = round(100 * said["cpu_s"] / sending_s, 1)
        self.monitor.spin_until(lambda: False, SETTLE_S)        # the last clouds, the last diagnostics
        return said, share

    def _start(self, name: str, *arguments: str) -> None:
        self._processes[name] = subprocess.Popen([sys.executable, *arguments], stdin=subprocess.DEVNULL)

    def _cpu_s(self) -> dict[str, float]:
        """CPU time that each process has used, seconds."""
        used = {}
        for name, process in self._processes.items():
            used[name] = cpu_s(process.pid)
        used["monitor"] = time.process_time()
        return used


def cpu_s(pid: int) -> float:
    """CPU time that a process and the processes under it have used, seconds; 0 once it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) * TICK_S + sum(cpu_s(int(child)) for child in children)


def tell(line: dict, out: Path | None) -> None:
    """Print a line of figures as JSON and, if `out` is given, append it to that file."""
    text = json.dumps(line)
    print(text, flush=True)
    if out:
        with out.open("a") as file:
            file.write(text + "\n")


def accounting(monitor) -> dict[str, int]:
    """All counts of drops and losses in the nodes' newest diagnostics."""
    return {f"{node}.{key}": int(value) for node, values in monitor.statuses.items() for key, value in values.items()
            if key.startswith("dropped") and not key.endswith("_per_s") or key in ("message_lost", "errors")}


def percentiles(latencies_ms) -> dict[str, float]:
    """p50, p95 and the largest, ms."""
    p50, p95, most = np.percentile(latencies_ms, [50, 95, 100]) if len(latencies_ms) else (np.nan,) * 3
    return {"p50": round(float(p50), 1), "p95": round(float(p95), 1), "max": round(float(most), 1)}
