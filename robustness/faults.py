"""Harm a running pipeline, round after round: it recovers, its frame counts add up, and nothing is broken.

Sketcher, reconstructor, recorder and bag recorder run as processes, fed by a driver of raw packets, four a frame. A
round picks a fault, does it, takes it back, and passes if

- clouds of photons that came after the fault are back within 3 s, with a point in nine of ten pixels;
- no cloud at any time shows the scene where it is not;
- nothing ended that was not ended on purpose, and nobody wrote a traceback;
- the frame counts of every node add up, and where driver and sketcher are not harmed, all packets sent are counted;
- recordings and bags that were finished open, and those that were cut off are repaired or refused in one line.

A round that fails leaves its logs beside the summary, and the pipeline is started anew. Faults of the disk and of
shared memory need root or user namespaces: they get disks of their own, which nobody else sees.
"""

import argparse
import os
import random
import statistics
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from robustness.fault_table import CLOUD_S, FAULTS, NODES
from robustness.fault_testbed import SUFFIX, FaultTestbed, enter_own_mounts
from srt3d_ros.processes import Process, join_private_network

BACK_S = 3.0
MAX_BACK_S = 30.0           # for which clouds are waited that have to be back earlier
OPEN_S = 300.0
LOOK = {"recorder": ("review", "--no-report", "--json"), "bag_recorder": ("reconstruct", "--json")}


@dataclass
class Round:
    number: int
    fault: str
    did: str = ""
    recovery_s: float | None = None
    lost: Counter = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


class Campaign:
    """Rounds on the same pipeline until one fails, then on another."""

    def __init__(self, seed: int, faults: list[str], folder: Path, own_mounts: bool, back_s: float):
        self._seed, self._faults, self._folder, self._own_mounts = seed, faults, folder, own_mounts
        self._back_s = back_s
        self._testbed: FaultTestbed | None = None

    def play(self, number: int) -> Round:
        """One round; the same number is the same fault."""
        choice = random.Random(f"{self._seed}/{number}")
        played = Round(number, self._faults[number % len(self._faults)])
        try:
            if self._testbed is None:
                self._testbed = FaultTestbed(self._folder / "run", self._own_mounts)
                self._testbed.__enter__()
                self._testbed.wait_for_cloud(MAX_BACK_S)
            self._harm(played, choice)
        except (AssertionError, TimeoutError) as problem:
            played.problems.append(str(problem))
        if self._testbed is not None:
            played.problems += self._unreadable()
        if played.problems:
            self.end(played)
        return played

    def _harm(self, played: Round, choice: random.Random) -> None:
        testbed, fault = self._testbed, FAULTS[played.fault]
        testbed.drive(sensor="")
        testbed.settle(NODES)
        testbed.replaced_before = len(testbed.replaced)
        testbed.misplaced.clear()
        lost, sent, came = testbed.losses(), testbed.drive(sensor=testbed.sensor), self._came()
        testbed.wait_for_cloud(CLOUD_S)
        played.did = fault.do(testbed, choice)
        played.recovery_s = round(testbed.wait_for_cloud(max(MAX_BACK_S, self._back_s)), 3)
        if played.recovery_s > self._back_s:
            played.problems.append(f"clouds were back after {played.recovery_s:.1f} s")
        for name in SUFFIX:
            testbed.wait(lambda: testbed.probe.total(name, "frames_out"), f"{name} to record")
        now = testbed.drive(sensor="")
        played.problems += [f"{name}: {amount} frames are not accounted for: {testbed.latest.get(name)}"
                            for name, amount in testbed.settle(NODES).items()]
        if fault.counted and (gone := (now - sent)["sent"] - (self._came() - came)):
            played.problems.append(f"{gone} of {(now - sent)['sent']} packets are not accounted for")
        played.lost = testbed.losses() - lost
        played.problems += [f"a cloud at {cloud.median_m:.2f} m" for cloud in testbed.misplaced[:3]]
        played.problems += testbed.failed()
        played.problems += [f"{name} wrote a traceback" for name, process in self._processes() if
                            "Traceback" in process.text]

    def _came(self) -> int:
        """Packets that the sketcher had, or knows that it missed."""
        counted = self._testbed.totals("sketcher")
        return counted["frames_in"] + counted["message_lost"]

    def _processes(self) -> list[tuple[str, Process]]:
        testbed = self._testbed
        return [*testbed.replaced[testbed.replaced_before:], *testbed.items()]

    def _unreadable(self) -> list[str]:
        """Try to open what was recorded, as its user would; returns what is wrong with it."""
        problems = []
        for name, path, whole in self._testbed.recorded:
            command, *options = LOOK[name]
            out = ["-o", f"{path}.npz"] if command == "reconstruct" else []
            process = Process([sys.executable, "-m", "srt3d_ros.cli.main", command, str(path), *options, *out])
            code = process.code(OPEN_S)
            refused = code == 2 and len(process.lines) == 1 and name == "bag_recorder" and not whole
            if "Traceback" in process.text or not (code == 0 or refused):
                problems.append(f"{path} does not open: {process.text}")
            for repaired in path.parent.glob(f"{path.stem}_repaired*"):
                repaired.unlink()
        self._testbed.recorded.clear()
        return problems

    def end(self, failed: Round | None = None) -> list[str]:
        """End the pipeline; returns what is wrong with what it recorded. Keeps the logs of a round that failed."""
        if self._testbed is None:
            return []
        self._testbed.__exit__()
        if failed is not None:
            folder = self._folder / f"round_{failed.number:03}"
            folder.mkdir(parents=True, exist_ok=True)
            for k, (name, process) in enumerate(self._processes()):
                (folder / f"{k}_{name}.log").write_text(f"{' '.join(process.command)}\n{process.text}\n")
        problems = self._unreadable()
        self._testbed.unmount()
        self._testbed = None
        return problems


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rounds", type=int, default=200, help="default: %(default)s")
    parser.add_argument("--seconds", type=float, default=float("inf"), metavar="S", help="end after so long (never)")
    parser.add_argument("--first", type=int, default=0, help="number of the first round, to repeat one")
    parser.add_argument("--only", nargs="+", choices=FAULTS, default=list(FAULTS), metavar="FAULT",
                        help=f"of {', '.join(FAULTS)}")
    parser.add_argument("--back-s", type=float, default=BACK_S, help="by when clouds must be back (%(default)g)")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    own_mounts = enter_own_mounts()
    if "ROS_DOMAIN_ID" not in os.environ:
        join_private_network()
    left_out = [] if own_mounts else [name for name in args.only if FAULTS[name].on_own_disks]
    if left_out:
        print(f"left out: {', '.join(left_out)}: they need root, or user namespaces", file=sys.stderr)
    campaign = Campaign(args.seed, [name for name in args.only if name not in left_out], args.out.parent / "faults",
                        own_mounts, args.back_s)
    rounds, at_the_end, end_s = [], [], time.monotonic() + args.seconds
    try:
        for number in tqdm(range(args.first, args.first + args.rounds), unit="round"):
            if time.monotonic() > end_s:
                break
            rounds.append(campaign.play(number))
            tqdm.write(f"round {number}, {rounds[-1].fault}: {rounds[-1].did}", file=sys.stderr)
    finally:
        at_the_end = campaign.end()
    summary = {name: _summary([played for played in rounds if played.fault == name])
               for name in FAULTS if any(played.fault == name for played in rounds)}
    verdicts = [(name, one["failed"] == 0, ", ".join(f"{key} {value}" for key, value in one.items()))
                for name, one in summary.items()]
    verdicts += [(f"round {played.number}, {played.fault} (--first {played.number} --rounds 1)", False, problem)
                 for played in rounds for problem in played.problems]
    verdicts.append(("what was recorded opens", not at_the_end, "; ".join(at_the_end) or "all"))
    return verdicts, {"seed": args.seed, "rounds": len(rounds), "left_out": left_out, "faults": summary}


def _summary(rounds: list[Round]) -> dict:
    times = [played.recovery_s for played in rounds if played.recovery_s is not None]
    lost = sum((played.lost for played in rounds), Counter())
    return {"rounds": len(rounds), "failed": sum(bool(played.problems) for played in rounds),
            "median_s": round(statistics.median(times), 2) if times else None,
            "max_s": round(max(times), 2) if times else None, "lost": dict(lost.most_common())}
