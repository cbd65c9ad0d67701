"""Harm a running pipeline, round after round: it recovers, its frame counts add up, and nothing is broken.

Sketcher, reconstructor, recorder and bag recorder run as processes, fed by a driver of raw packets, four a frame. Each
round does the next fault, takes it back, and passes if

- clouds of photons that came after the fault are back within 3 s, with a point in nine of ten pixels;
- no cloud at any time shows the scene where it is not;
- nothing ended that was not ended on purpose, and nobody wrote a traceback;
- the frame counts of every node add up, and where driver and sketcher are not harmed, all packets sent are counted;
- recordings and bags that were finished open, and those that were cut off are repaired or refused in one line.

The first round that fails is the last, and leaves its logs beside the summary. Faults of the disk and of shared memory
need root or user namespaces: they get disks of their own, which nobody else sees.
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


@dataclass
class Round:
    fault: str
    did: str = ""
    recovery_s: float | None = None
    lost: Counter = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


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
    faults = [name for name in args.only if name not in left_out]
    rounds, end_s, folder = [], time.monotonic() + args.seconds, args.out.parent / "faults"
    with FaultTestbed(folder, own_mounts) as testbed:
        for number in tqdm(range(args.first, args.first + args.rounds), unit="round"):
            rounds.append(played := Round(faults[number % len(faults)]))
            play(testbed, played, random.Random(f"{args.seed}/{number}"), args.back_s)
            tqdm.write(f"round {number}, {played.fault}: {played.did or 'not done'}", file=sys.stderr)
            if played.problems or time.monotonic() > end_s:
                break
    unreadable = open_recorded(testbed.recorded)
    for k, (name, process) in enumerate([*testbed.replaced, *testbed.items()] if played.problems else ()):
        (folder / f"{k}_{name}.log").write_text(f"{' '.join(process.command)}\n{process.text}\n")
    summary = {name: summarise([played for played in rounds if played.fault == name])
               for name in faults if any(played.fault == name for played in rounds)}
    verdicts = [(name, one["failed"] == 0, ", ".join(f"{key} {value}" for key, value in one.items()))
                for name, one in summary.items()]
    verdicts += [(f"round {number}, {played.fault} (--first {number} --rounds 1)", False, problem)
                 for problem in played.problems]
    verdicts.append(("what was recorded opens", not unreadable, "; ".join(unreadable) or "all"))
    return verdicts, {"seed": args.seed, "rounds": len(rounds), "left_out": left_out, "faults": summary}


def play(testbed: FaultTestbed, played: Round, choice: random.Random, back_s: float) -> None:
    """Do the round's fault and note what came of it."""
    fault, replaced = FAULTS[played.fault], len(testbed.replaced)
    testbed.misplaced.clear()
    try:
        testbed.drive(sensor="")
        testbed.settle(NODES)
        lost, came, sent = testbed.losses(), packets_counted(testbed), testbed.drive(sensor=testbed.sensor)
        testbed.wait_for_cloud(MAX_BACK_S)
        played.did = fault.do(testbed, choice)
        played.recovery_s = round(testbed.wait_for_cloud(max(MAX_BACK_S, back_s)), 3)
        if played.recovery_s > back_s:
            played.problems.append(f"clouds were back after {played.recovery_s:.1f} s")
        for name in SUFFIX:
            testbed.wait(lambda: testbed.probe.total(name, "frames_out"), f"{name} to record", CLOUD_S)
        sent = testbed.drive(sensor="") - sent
        played.problems += [f"{name}: {amount} frames are not accounted for: {testbed.latest.get(name)}"
                            for name, amount in testbed.settle(NODES).items()]
        if fault.counted and (gone := sent["sent"] - (packets_counted(testbed) - came)):
            played.problems.append(f"{gone} of {sent['sent']} packets are not accounted for")
        played.lost = testbed.losses() - lost
    except (AssertionError, TimeoutError) as problem:
        played.problems.append(str(problem))
    played.problems += [f"a cloud at {median_m:.2f} m" for median_m in testbed.misplaced[:3]] + testbed.failed()
    played.problems += [f"{name} wrote a traceback" for name, process in
                        (*testbed.replaced[replaced:], *testbed.items()) if "Traceback" in process.text]


def packets_counted(testbed: FaultTestbed) -> int:
    """Packets that the sketcher had, or knows that it missed."""
    counted = testbed.totals("sketcher")
    return counted["frames_in"] + counted["message_lost"]


def open_recorded(recorded: list[tuple[str, Path, bool]]) -> list[str]:
    """Open what was recorded, as its user would; returns what is wrong with it."""
    problems = []
    for name, path, whole in tqdm(recorded, unit="recording"):
        command = ["review", "--no-report"] if name == "recorder" else ["reconstruct", "-o", f"{path}.npz"]
        process = Process([sys.executable, "-m", "srt3d_ros.cli.main", *command, "--json", str(path)])
        code = process.code(OPEN_S)
        refused = code == 2 and len(process.lines) == 1 and name == "bag_recorder" and not whole
        if "Traceback" in process.text or not (code == 0 or refused):
            problems.append(f"{path} does not open: {process.text}")
        for repaired in path.parent.glob(f"{path.stem}_repaired*"):     # there may be no room for all of them
            repaired.unlink()
    return problems


def summarise(rounds: list[Round]) -> dict:
    times = [played.recovery_s for played in rounds if played.recovery_s is not None]
    lost = sum((played.lost for played in rounds), Counter())
    return {"rounds": len(rounds), "failed": sum(bool(played.problems) for played in rounds),
            "median_s": round(statistics.median(times), 2) if times else None,
            "max_s": round(max(times), 2) if times else None, "lost": dict(lost.most_common())}
