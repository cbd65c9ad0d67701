"""Step 4 of docs/quickstart-driver.md, measured: how many of the 50 clouds a second come, and when the first one does.

The page's driver sends 100 messages of 3 MB a second to `srt3d up --config spad_32x32_gates`, without and with a
recording in turn. One line each: clouds a second as they arrive here after SETTLE_S, seconds from the start of the
command to the first cloud, CPU time of the command in % of a core, and the drops that the nodes report.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.pipeline import cpu_s, percentiles
from robustness.testbed import Testbed
from srt3d_ros import shared_files
from srt3d_ros.nodes.transport import PROFILE_VARIABLE, PROFILES

UP = [sys.executable, "-m", "srt3d_ros.cli.main", "up", "--config", "spad_32x32_gates"]
START_S, SETTLE_S = 60.0, 3.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=20.0, help="that are counted (%(default)g)")
    parser.add_argument("--rounds", type=int, default=1, help="(%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    for _ in range(args.rounds):
        for record in (False, True):
            yield {"record": record, **measure(record, args.seconds)}


def measure(record: bool, seconds: float) -> dict:
    """The figures with or without a recording."""
    with TemporaryDirectory() as folder, Testbed({}, Path(folder) / "quickstart") as testbed:
        probe, profile = testbed.probe, str(shared_files.find(f"{PROFILES}/fastdds_64mb.xml"))
        testbed.run("driver", [sys.executable, str(shared_files.find("examples/spad_driver.py"))],
                    environment={PROFILE_VARIABLE: profile})
        started_ns = time.time_ns()
        up = testbed.run("up", [*UP, *(["--record", str(testbed.folder / "run.rrd")] if record else [])])
        testbed.wait(lambda: probe.arrivals, "a cloud", START_S)
        testbed.spin(SETTLE_S)
        first, used_s, began = len(probe.arrivals), cpu_s(up.pid), time.monotonic()
        testbed.spin(seconds)
        lasted_s, used_s = time.monotonic() - began, cpu_s(up.pid) - used_s
        arrivals = probe.arrivals[first:]
        testbed.stop()
        return {"clouds_per_s": round(len(arrivals) / lasted_s, 1),
                "first_cloud_s": round((probe.arrivals[0].received_ns - started_ns) * 1e-9, 2),
                "latency_ms": percentiles([arrival.latency_ms for arrival in arrivals]),
                "cpu_percent": round(100 * used_s / lasted_s), "exit_code": up.returncode,
                "dropped_in_all": dict(testbed.losses())}
