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
from srt3d_ros.processes import Processes

MAX_RESTARTS = 5            # of a target whose process an input has ended
POLL_S = 0.2
ENDED_BY_INPUT = ("crash-*", "timeout-*", "oom-*", "leak-*")      # what libFuzzer saves
TRIED, READ, DEFECTS = range(3)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = list(targets())
    parser.add_argument("--target", nargs="+", choices=names, default=names, metavar="NAME",
                        help=f"default: all, {', '.join(names)}")
    parser.add_argument("--rounds", type=int, metavar="N", help="inputs for each target; default: more for faster ones")
    parser.add_argument("--scale", type=float, default=1.0, metavar="X", help="of the default numbers (1)")
    parser.add_argument("--seconds", type=float, default=float("inf"), metavar="S", help="end after so long (never)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="targets at a time (as many as cores)")
    parser.add_argument("--repeat", type=Path, metavar="FILE", help="try this input only")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    chosen = [target for name, target in targets().items() if name in args.target]
    if args.repeat:
        return [_repeat(target, args.repeat.read_bytes()) for target in chosen], {}
    if importlib.util.find_spec("atheris") is None:
        raise SystemExit(f"atheris is not installed: {sys.executable} -m pip install atheris")
    rounds = {target.name: args.rounds or max(round(target.rounds * args.scale), 1) for target in chosen}
    folder = args.out.parent / "fuzz"
    ended = Campaign(chosen, rounds, args.seed, folder).run(args.jobs, args.seconds)
    results = {name: _result(folder / name) for name in rounds}
    verdicts = [(name, not one["defects"] and (ended == "seconds" or one["tried"] >= rounds[name]),
                 f"{one['tried']:,} tried, {one['read']:,} read, {one['defects']} defects")
                for name, one in results.items()]
    return verdicts, {"seed": args.seed, "ended_by": ended, "tried": sum(one["tried"] for one in results.values()),
                      "targets": results}


class Campaign:
    """So many inputs for each target, one process a target; what they leave lies in a folder each."""

    def __init__(self, chosen: list[Target], rounds: dict[str, int], seed: int, folder: Path):
        self._targets, self._rounds, self._seed, self._folder = chosen, rounds, seed, folder
        for name in rounds:
            (folder / name / "corpus").mkdir(parents=True, exist_ok=True)
            for old in (path for path in (folder / name).iterdir() if path.is_file()):
                old.unlink()
            np.zeros(3, np.uint64).tofile(folder / name / "counts")

    def run(self, jobs: int, seconds: float) -> str:
        """Try the inputs, so many targets at a time; what ended it: "rounds", "seconds" or "Ctrl-C"."""
        end, left = time.monotonic() + seconds, list(self._targets)
        attempts = dict.fromkeys(self._rounds, 0)
        with Processes(folder=self._folder) as workers, tqdm(total=sum(self._rounds.values()), unit="input") as bar:
            try:
                while left or any(worker.running for worker in workers.values()):
                    while left and sum(worker.running for worker in workers.values()) < jobs:
                        self._start(workers, left.pop(0), attempts)
                    time.sleep(POLL_S)
                    bar.update(sum(self._tried(name) for name in self._rounds) - bar.n)
                    left += [target for target in self._targets if workers.ended(target.name) and target not in left
                             and self._tried(target.name) < self._rounds[target.name]
                             and attempts[target.name] < MAX_RESTARTS]
                    if time.monotonic() > end:
                        return "seconds"
            except KeyboardInterrupt:
                return "Ctrl-C"
        return "rounds"

    def _start(self, workers: Processes, target: Target, attempts: dict[str, int]) -> None:
        """An input that ends the process ends it for itself only: the next process goes on with another seed."""
        left = self._rounds[target.name] - self._tried(target.name)
        seed = self._seed + attempts[target.name]
        attempts[target.name] += 1
        workers.run(target.name, [sys.executable, "-m", "robustness.fuzz_worker", target.name, str(left), str(seed),
                                  str(self._folder / target.name)], environment=target.environment)

    def _tried(self, name: str) -> int:
        return int(np.fromfile(self._folder / name / "counts", np.uint64)[TRIED])


def _result(folder: Path) -> dict[str, int]:
    """Inputs that were tried, that could be read, and that are defects."""
    counts = np.fromfile(folder / "counts", np.uint64).tolist()
    ended = sum(1 for pattern in ENDED_BY_INPUT for _ in folder.glob(pattern))
    return {"tried": counts[TRIED], "read": counts[READ], "defects": counts[DEFECTS] + ended}


def _repeat(target: Target, raw: bytes) -> tuple[str, bool, str]:
    os.environ.update(target.environment)
    read, _ = target.make()
    try:
        return target.name, True, "read" if try_input(target, read, raw) else "refused"
    except Defect as defect:
        return target.name, False, str(defect)
