"""Step 4 of docs/quickstart-driver.md, measured: how many of the 50 clouds a second come, and when the first one does.

    PYTHONPATH=. python benchmarks/quickstart.py [--seconds 20] [--rounds 1] [--way up processes] [--out FILE]

The page's driver, at 100 messages of 3 MB a second, runs all the time. `up` is `srt3d up --config spad_32x32_gates`;
`processes` starts the same nodes by hand, each with the arguments that `ros2 launch` gives it. Both run without and
with a recording, in turn, so that a load from elsewhere meets both. One JSON line each: clouds a second as they arrive
here after SETTLE_S, seconds from the start of the command to the first cloud, CPU time of the command in % of a core,
and the drops that the nodes report.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from live import accounting, cpu_s, percentiles, tell

from srt3d_ros import shared_files
from srt3d_ros.processes import join_private_network

ROOT = Path(__file__).resolve().parent.parent
SRT3D = (sys.executable, "-m", "srt3d_ros.cli.main")
CONFIG = "spad_32x32_gates"
START_S, SETTLE_S, END_S = 60.0, 3.0, 30.0


def up(recording: str | None) -> list[list[str]]:
    """The command of the page."""
    return [[*SRT3D, "up", "--config", CONFIG, *(["--record", recording] if recording else [])]]


def processes(recording: str | None) -> list[list[str]]:
    """What launch/srt3d.launch.py starts, all at once."""
    file = str(shared_files.find(f"config/{CONFIG}.yaml"))
    nodes = [[*SRT3D, "node", name, "--ros-args", "--params-file", file] for name in ("reconstructor", "sketcher")]
    if recording:
        nodes.insert(0, [*SRT3D, "node", "recorder", "--ros-args", "-p", f"path:={recording}"])
    return nodes


WAYS = {"up": up, "processes": processes}


def measure(way: str, record: bool, seconds: float) -> dict:
    """Run one way of starting the pipeline; its figures."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    with PipelineProbe(keep_every=10**9) as monitor, tempfile.TemporaryDirectory(prefix="srt3d-quickstart-") as folder:
        commands = WAYS[way](f"{folder}/run.rrd" if record else None)
        load, started_ns = os.getloadavg()[0], time.time_ns()
        running = [subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                   for command in commands]
        try:
            if not monitor.spin_until(lambda: monitor.arrivals, START_S):
                raise SystemExit(f"{way}: no cloud in {START_S:.0f} s")
            monitor.spin_until(lambda: False, SETTLE_S)
            first, used_s = len(monitor.arrivals), sum(cpu_s(process.pid) for process in running)
            began = time.monotonic()
            monitor.spin_until(lambda: False, seconds)
            lasted_s = time.monotonic() - began
            used_s = sum(cpu_s(process.pid) for process in running) - used_s
            arrivals = monitor.arrivals[first:]
        finally:
            for process in running:
                process.send_signal(signal.SIGINT)
            for process in running:
                process.wait(END_S)
        return {"way": way, "record": record, "load": round(load, 1),
                "clouds_per_s": round(len(arrivals) / lasted_s, 1),
                "first_cloud_s": round((monitor.arrivals[0].received_ns - started_ns) * 1e-9, 2),
                "latency_ms": percentiles([arrival.latency_ms for arrival in arrivals]),
                "cpu_percent": round(100 * used_s / lasted_s),
                "exit_codes": [process.returncode for process in running],
                "dropped_in_all": {key: count for key, count in accounting(monitor).items() if count}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="that are counted; default: %(default)g")
    parser.add_argument("--rounds", type=int, default=1, help="default: %(default)d")
    parser.add_argument("--way", choices=WAYS, nargs="+", default=list(WAYS))
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to which the figures are appended")
    args = parser.parse_args()
    join_private_network()
    profile = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(ROOT / "config" / "fastdds_64mb.xml")}
    driver = subprocess.Popen([sys.executable, str(ROOT / "examples" / "spad_driver.py")], env=os.environ | profile)
    try:
        for _ in range(args.rounds):
            for record in (False, True):
                for way in args.way:
                    tell(measure(way, record, args.seconds), args.out)
    finally:
        driver.send_signal(signal.SIGINT)
        driver.wait(END_S)


if __name__ == "__main__":
    main()
