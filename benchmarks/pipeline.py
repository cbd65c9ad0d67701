"""What the driver of a testbed sends in phases, what comes of it, and what the processes use meanwhile."""

import os
import time
from pathlib import Path

import numpy as np

from robustness.testbed import Testbed

TICK_S = 1 / os.sysconf("SC_CLK_TCK")


def send(testbed: Testbed, sensor: str, *phases: tuple[float, float]) -> list[dict]:
    """Have the driver send at each of these rates for so many seconds; what it did, arrivals and CPU of each phase.

    A cloud belongs to the phase in which the acquisition of its frame began. Latencies are from there on.
    """
    results = []
    for rate_hz, seconds in phases:
        before, used_s, began_ns = testbed.drive(sensor=sensor, rate_hz=rate_hz), _cpu_s(testbed), time.time_ns()
        testbed.spin(seconds)
        ended_ns, done = time.time_ns(), testbed.drive() - before
        results.append({"rate_hz": rate_hz, "began_ns": began_ns, "ended_ns": ended_ns, "sent": done["sent"],
                        "skipped": done["skipped"], "MB_per_s": round(done["bytes"] * 1e-6 / seconds, 1),
                        "reconstruct_ms": float(testbed.probe.value("reconstructor", "reconstruct_ms") or "nan"),
                        "cpu_percent": {name: round((now_s - used_s[name]) * 1e11 / (ended_ns - began_ns), 1)
                                        for name, now_s in _cpu_s(testbed).items()}})
    testbed.drive(sensor="")
    testbed.settle(testbed.parameters)
    for phase in results:
        phase["arrivals"] = [arrival for arrival in testbed.probe.arrivals
                             if phase["began_ns"] <= arrival.stamp_ns < phase["ended_ns"]]
    return results


def _cpu_s(testbed: Testbed) -> dict[str, float]:
    return {name: cpu_s(process.pid) for name, process in testbed.items()} | {"probe": time.process_time()}


def cpu_s(pid: int) -> float:
    """CPU time that a process and the processes under it have used, seconds; 0 once it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) * TICK_S + sum(cpu_s(int(child)) for child in children)


def percentiles(latencies_ms) -> dict[str, float]:
    """p50, p95 and the largest, ms."""
    values = np.percentile(latencies_ms, [50, 95, 100]) if len(latencies_ms) else [np.nan] * 3
    return dict(zip(("p50", "p95", "max"), np.round(values, 1).tolist()))
