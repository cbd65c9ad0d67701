"""python -m robustness COMMAND: try to break the package. Each command prints a verdict for each check.

  fuzz     mutated messages, files, parameters and command lines: read, or refused in one line
  frames   odd sensors and frames through every method: the clouds hold numbers
  faults   processes, packets, clocks and disks that fail under running nodes: clouds come back, counts add up
  soak     the pipeline for half an hour: nothing grows, nothing is lost

Exit code 0 if all checks hold, 1 if not. `python -m robustness COMMAND --help` lists the options.
"""

import argparse
import importlib
import json
import math
import signal
import sys
import time
from pathlib import Path

from srt3d_ros.versions import machine

COMMANDS = ("fuzz", "frames", "faults", "soak")
INTERRUPTED = 130


def main() -> int:
    parser = argparse.ArgumentParser("python -m robustness", description=__doc__.partition("\n\n")[2],
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    chosen = [name for name in COMMANDS if name in sys.argv[1:2]]      # the others may need what is not installed
    for name in chosen or COMMANDS:
        own = commands.add_parser(name)
        if chosen:
            module = importlib.import_module(f"robustness.{name}")
            own.description, own.formatter_class = module.__doc__, argparse.RawDescriptionHelpFormatter
            if hasattr(module, "add_arguments"):
                module.add_arguments(own)
            if hasattr(module, "ROUNDS"):
                own.add_argument("--rounds", type=int, default=module.ROUNDS,
                                 help=f"default: {module.ROUNDS or 'more for faster targets'}")
                own.add_argument("--seconds", type=float, default=math.inf, metavar="S", help="end after so long")
                own.add_argument("--first", type=int, default=0, help="number of the first round, to repeat one")
        own.add_argument("--seed", type=int, default=1, help="default: %(default)s")
        own.add_argument("--out", type=Path, default=Path("build/robustness") / f"{name}.json",
                         help="the summary to write, logs beside it; default: %(default)s")
    args = parser.parse_args()
    args.end_s = time.monotonic() + args.seconds
    signal.signal(signal.SIGTERM, signal.default_int_handler)       # as Ctrl-C: the processes it started are ended
    args.out.parent.mkdir(parents=True, exist_ok=True)
    try:
        return finish(args, *module.run(args))
    except KeyboardInterrupt:
        return INTERRUPTED


def finish(args: argparse.Namespace, verdicts: list[tuple[str, bool, str]], summary: dict) -> int:
    """Print a line for each (check, whether it holds, what was seen), write the summary; the exit code."""
    failed = [f"{check}: {seen}" for check, holds, seen in verdicts if not holds]
    for check, holds, seen in verdicts:
        print(f"{'holds' if holds else 'FAILS'}  {check}: {seen}")
    facts = {"command": " ".join(["python -m robustness", *sys.argv[1:]]), "date": time.strftime("%Y-%m-%d"),
             "machine": machine(), "failed": failed, **summary}
    lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in facts.items())
    args.out.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    print(f"{args.command}: {'FAILS' if failed else 'holds'}; {args.out}")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
