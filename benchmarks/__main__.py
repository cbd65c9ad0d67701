"""Run one of the developers' benchmarks: python -m benchmarks NAME [--help] [--out FILE] …

Each measurement is printed as a line of JSON that also names the machine. --out appends the lines to a file.
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

from srt3d_ros.processes.versions import versions

NAMES = ("ablation", "calibration", "false_alarms", "free", "motion", "pileup", "ros", "speed")


def machine() -> dict:
    """The date, processor, number of cores, load and versions that a line is measured with."""
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return {"date": date.today().isoformat(), "machine": model[1].strip() if model else platform.machine(),
            "cpus": len(os.sched_getaffinity(0)), "load_1min": round(os.getloadavg()[0], 2)} | versions()


def main() -> None:
    if sys.argv[1:2] in ([], ["-h"], ["--help"]):
        print(f"{__doc__}\nNAME: {', '.join(NAMES)}")
        return
    name, *rest = sys.argv[1:]
    if name not in NAMES:
        sys.exit(f"{name}: expected {', '.join(NAMES)}")
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
