"""Try inputs made by damaging real messages and files: bits, bytes, lengths and numbers.

Each target must read its input or refuse it in one line: no other exception, no crash, at most a second of work and
256 MB of memory. An input depends on the seed and its own number alone: `--target mat --first 1234 --rounds 1` repeats
one.
"""

import argparse
import multiprocessing
import random
import time
from multiprocessing.connection import Connection

from tqdm import tqdm

from robustness.targets import Defect, damaged, targets, try_input
from srt3d_ros.errors import printable

ROUNDS = None               # of each target its own
HANG_S = 60.0
MAX_DEFECTS = 5             # of a target; then it is left
SPAWN = multiprocessing.get_context("spawn")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = list(targets())
    parser.add_argument("--target", nargs="+", choices=names, default=names, metavar="NAME",
                        help=f"default: all, {', '.join(names)}")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    verdicts, results = [], {}
    for name in tqdm(args.target, unit="target"):
        target = targets()[name]
        numbers = range(args.first, args.first + (args.rounds or target.rounds))
        tried, was_read, defects = _fuzz(name, numbers, args.seed, args.end_s)
        results[name] = {"tried": tried, "read": was_read, "defects": len(defects)}
        verdicts.append((name, not defects, "; ".join([f"{tried} tried, {was_read} read", *defects])))
    return verdicts, {"seed": args.seed, "tried": sum(one["tried"] for one in results.values()), "targets": results}


def _fuzz(name: str, numbers: range, seed: int, end_s: float) -> tuple[int, int, list[str]]:
    """Try inputs in a process of its own, in another if one ends it; how many were tried and read, and the defects."""
    tried, was_read, defects = 0, 0, []
    while tried < len(numbers) and len(defects) < MAX_DEFECTS and time.monotonic() < end_s:
        receiver, sender = SPAWN.Pipe(duplex=False)
        worker = SPAWN.Process(target=_try_all, args=(name, numbers[tried:], seed, sender), daemon=True)
        worker.start()
        sender.close()
        try:
            while tried < len(numbers) and len(defects) < MAX_DEFECTS and time.monotonic() < end_s:
                if not receiver.poll(HANG_S):
                    raise EOFError      # as where the process has ended
                result = receiver.recv()
                tried += 1
                was_read += result is True
                defects += [f"input {numbers[tried - 1]}: {result}"] if isinstance(result, str) else []
        except EOFError:
            defects.append(f"input {numbers[tried]}: no answer in {HANG_S:g} s, or the process ended")
            tried += 1
        worker.kill()
        worker.join()
    return tried, was_read, defects


def _try_all(name: str, numbers: range, seed: int, sender: Connection) -> None:
    """Send for each input whether it was read, or the defect."""
    read, examples = targets()[name].make()
    for number in numbers:
        try:
            sender.send(try_input(name, read, damaged(examples, random.Random(f"{seed}/{number}"))))
        except Defect as defect:
            sender.send(printable(str(defect))[:1000])
