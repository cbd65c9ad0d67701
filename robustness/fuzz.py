"""Try inputs made by mutation of real messages and files, guided by the code that they reach.

    .venv/bin/pip install atheris
    .venv/bin/python -m robustness fuzz

Each target must read its input or refuse it in one line: no other exception, no crash, at most a second of work and
256 MB of memory. Inputs that break this are kept beside the summary, with the reason, for --repeat; so is the corpus,
where the next run begins.
"""

import argparse
import importlib.util
import os
import sys
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from robustness.targets import Defect, Target, targets, try_input
from srt3d_ros.processes import Process, wait_until

MAX_RESTARTS = 5            # of a target whose process an input has ended
ENDED_BY_INPUT = ("crash-*", "timeout-*", "oom-*", "leak-*")      # what libFuzzer saves
TRIED, READ, DEFECTS = range(3)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = list(targets())
    parser.add_argument("--target", nargs="+", choices=names, default=names, metavar="NAME",
                        help=f"default: all, {', '.join(names)}")
    parser.add_argument("--rounds", type=int, metavar="N", help="inputs for each target; default: more for faster ones")
    parser.add_argument("--scale", type=float, default=1.0, metavar="X", help="of the default numbers (1)")
    parser.add_argument("--seconds", type=float, default=float("inf"), metavar="S", help="end after so long (never)")
    parser.add_argument("--repeat", type=Path, metavar="FILE", help="try this input only")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    chosen = [target for name, target in targets().items() if name in args.target]
    if args.repeat:
        return [_repeat(target, args.repeat.read_bytes()) for target in chosen], {}
    if importlib.util.find_spec("atheris") is None:
        raise SystemExit(f"atheris is not installed: {sys.executable} -m pip install atheris")
    end_s, verdicts, results = time.monotonic() + args.seconds, [], {}
    for target in tqdm(chosen, unit="target"):
        rounds = args.rounds or max(round(target.rounds * args.scale), 1)
        tried, was_read, defects = _fuzz(target, rounds, args.seed, args.out.parent / "fuzz" / target.name, end_s)
        results[target.name] = {"tried": tried, "read": was_read, "defects": defects}
        enough = tried >= rounds or time.monotonic() > end_s
        verdicts.append((target.name, enough and not defects, f"{tried} tried, {was_read} read, {defects} defects"))
    return verdicts, {"seed": args.seed, "tried": sum(one["tried"] for one in results.values()), "targets": results}


def _fuzz(target: Target, rounds: int, seed: int, folder: Path, end_s: float) -> tuple[int, int, int]:
    """Try inputs in a process of its own, in another if one ends it; how many were tried, read, and are defects."""
    (folder / "corpus").mkdir(parents=True, exist_ok=True)
    for old in (path for path in folder.iterdir() if path.is_file()):
        old.unlink()
    counts = np.memmap(folder / "counts", np.uint64, "w+", shape=3)
    for attempt in range(MAX_RESTARTS):
        left = rounds - int(counts[TRIED])
        if left <= 0 or time.monotonic() > end_s:
            break
        worker = Process([sys.executable, "-m", "robustness.fuzz_worker", target.name, str(left), str(seed + attempt),
                          str(folder)], environment=target.environment)
        try:
            wait_until(lambda: not worker.running, end_s - time.monotonic())
        finally:
            worker.stop()
        (folder / "log.txt").write_text(worker.text)
    ended = sum(1 for pattern in ENDED_BY_INPUT for _ in folder.glob(pattern))
    return int(counts[TRIED]), int(counts[READ]), int(counts[DEFECTS]) + ended


def _repeat(target: Target, raw: bytes) -> tuple[str, bool, str]:
    os.environ.update(target.environment)
    read, _ = target.make()
    try:
        return target.name, True, "read" if try_input(target, read, raw) else "refused"
    except Defect as defect:
        return target.name, False, str(defect)
