"""Run one of the developers' benchmarks: python -m benchmarks NAME [--help] [--out FILE] …

Each measurement is a line of JSON with the machine that it was made on, printed and, with --out, appended to a file.
"""

import argparse
import json
import os
import platform
import re
import sys
from datetime import date
from importlib import import_module
from pathlib import Path

from srt3d_ros.nodes.versions import versions

PURPOSES = {
    "ablation": "quality and time with each constant of the method halved, doubled and off",
    "accuracy": "true and false detections and depth error against photons, by method",
    "animation": "clouds of a moving sensor as an animated picture: photons added, and moved first",
    "calibration": "how often depth errors are within the standard deviations that points claim",
    "choices": "what a gate and the background that is assumed change",
    "deskew": "time to move the parts of a frame to one instant",
    "false_alarms": "points where there is only background, beside the rate that was asked for",
    "figure1": "time of a frame against its photons, by method: Figure 1 of the paper",
    "gpu": "what only a GPU can show: the CPU's points, times, memory (eight minutes)",
    "gpu_cost": "kernels and bytes of a frame on a GPU, counted without one, and the times that follow",
    "motion": "depth error of a sensor that moves: at rest, and with photons added as they are, and moved first",
    "pileup": "depth and intensity of a detector that sees the first photon of each laser cycle",
    "ros": "latency and losses of frames through ROS 2 nodes, by rate",
    "table1": "time and memory of a frame by size: Table 1 of the paper",
    "two_machines": "sketches over links that are slow, lose packets or change: what passes, how late (root)",
}


def machine() -> dict:
    """Date, processor, number of its cores, load, and versions."""
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return {"date": date.today().isoformat(), "machine": model[1].strip() if model else platform.machine(),
            "cpus": len(os.sched_getaffinity(0)), "load_1min": round(os.getloadavg()[0], 2)} | versions()


def main() -> None:
    if sys.argv[1:2] in ([], ["-h"], ["--help"]):
        names = "\n".join(f"    {name:<14}{purpose}" for name, purpose in PURPOSES.items())
        print(f"{__doc__}\n{names}")
        return
    name, *rest = sys.argv[1:]
    if name not in PURPOSES:
        sys.exit(f"{name}: expected {', '.join(PURPOSES)}")
    module = import_module(f"benchmarks.{name}")
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks {name}", description=module.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, metavar="FILE", help="append the lines to this file")
    module.add_options(parser)
    args = parser.parse_args(rest)
    for line in module.run(args):
        text = json.dumps(line | machine(), ensure_ascii=False)
        print(text, flush=True)
        if args.out:
            with args.out.open("a", encoding="utf-8") as file:
                file.write(text + "\n")


if __name__ == "__main__":
    main()
