"""Five times the photons that the machine can take, for a while: what is dropped, and how soon all is well again.

141 × 141 pixels with 10 photons each. First the rate is found that the machine can take: what comes out when too much
goes in. Then half of that rate, five times that rate, and half of it again are sent, a line each. Latency counts from
where a frame's acquisition ends. In the last line `unaccounted` are frames that neither came out nor were counted as
dropped anywhere; `recovery_s` is when, after the overload, a second began in which nothing was lost and latency was as
before it.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.pipeline import percentiles, send
from robustness.testbed import Testbed
from srt3d_ros.benchmark.frames import photons_of, sensor_of

SIDE, PPP, TIMES = 141, 10.0, 5
PROBE_HZ, PROBE_S, NORMAL_S = 60, 5, 6
PERIODS = 3                             # of the rate that the machine can take: what a frame may wait
NORMAL = 1.5                            # times the latency (95 %) before: as before


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=10.0, help="of overload (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    sensor = sensor_of(SIDE)
    with (TemporaryDirectory() as folder,
          Testbed({"reconstructor": {}, "sketcher": {}}, Path(folder) / "overload") as testbed):
        testbed.write_packets("scanner", sensor, [photons_of(sensor, PPP)])
        testbed.start("driver")
        send(testbed, "scanner", (10, 2))       # compiles for the sensor
        (probed,) = send(testbed, "scanner", (PROBE_HZ, PROBE_S))
        capacity_hz = max(len(probed["arrivals"]) / PROBE_S, 2.0)
        normal, clouds = (capacity_hz / 2, NORMAL_S), len(testbed.probe.arrivals)
        lost, sent = testbed.losses(), testbed.drive()["sent"]
        phases = send(testbed, "scanner", normal, (TIMES * capacity_hz, args.seconds), normal)
        dropped, sent = testbed.losses() - lost, testbed.drive()["sent"] - sent
        clouds = len(testbed.probe.arrivals) - clouds
    late_ms = [np.array([arrival.latency_ms for arrival in phase["arrivals"]]) - 1e3 / phase["rate_hz"]
               for phase in phases]
    for name, phase, latencies_ms in zip(("before", "overload", "after"), phases, late_ms):
        yield {"phase": name, **phase, "arrivals": len(latencies_ms), "latency_ms": percentiles(latencies_ms)}
    good_ns = [arrival.stamp_ns for arrival, ms in zip(phases[2]["arrivals"], late_ms[2])
               if ms < NORMAL * np.percentile(late_ms[0], 95)]
    yield {"capacity_hz": round(capacity_hz, 1), "sent": sent, "clouds": clouds, "dropped": dict(dropped),
           "unaccounted": sent - clouds - dropped.total(),
           "bound_ms": round(PERIODS * 1e3 / capacity_hz + phases[1]["reconstruct_ms"], 1),
           "recovery_s": recovery_s(good_ns, phases[2])}


def recovery_s(good_ns: list[int], phase: dict) -> float:
    """From the beginning of a phase to the first frame with which a second of good frames begins; infinite if none."""
    frames, second_ns = max(round(phase["rate_hz"]), 2), (1 + 0.5 / phase["rate_hz"]) * 1e9
    return next((round((first - phase["began_ns"]) * 1e-9, 2) for first, last in zip(good_ns, good_ns[frames - 1:])
                 if last - first < second_ns), float("inf"))
