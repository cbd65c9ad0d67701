"""Harm a running pipeline, round after round: it recovers, its frame counts add up, and nothing is broken.

Sketcher, reconstructor, recorder and bag recorder run as processes, fed by a driver of raw packets, four a frame. Each
round does the next fault, takes it back, and passes if

- clouds of photons that came after the fault are back within 3 s, with a point in nine of ten pixels;
- no cloud at any time shows the scene where it is not;
- nothing ended that was not ended on purpose, and nobody wrote a traceback;
- the frame counts of every node add up, and where driver and sketcher are not harmed, all packets sent are counted;
- recordings and bags that were finished open, and those that were cut off are repaired or refused in one line.

The first round that fails is the last, and leaves its logs beside the summary.
"""

import argparse
import random
import signal
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tqdm import tqdm

from robustness.fault_testbed import SENSORS, SUFFIX, FaultTestbed
from srt3d_ros.processes import STOP_TIMEOUT_S, Process, node_command

NODES = ("sketcher", "reconstructor", *SUFFIX)
HELD_S, STOPPED_S = 2.0, 3.0
LATE_S = 0.6                # more than a late packet is late
SHARE = 0.3                 # of the packets
CLOUD_S = 10.0              # for clouds that a fault must not stop
BACK_S = 3.0
ROUNDS = 200
MAX_BACK_S = 30.0           # for which clouds are waited that have to be back earlier
OPEN_S = 300.0

# The faults: each does its harm, checks that it was done, takes it back, and returns a few words on what it did.


def end(testbed: FaultTestbed, name: str, number: int) -> None:
    """End a process; in order, its last diagnostics must balance, but the driver has none."""
    process = testbed[name]
    process.send(number)
    testbed.wait(lambda: not process.running, f"the end of {name}", STOP_TIMEOUT_S)
    if name != "driver" and number != signal.SIGKILL:
        assert process.returncode == 0, f"{name} {process.ending}:\n{process.text}"
        balanced = testbed.saw(lambda: not testbed.unbalanced([name]), LATE_S + STOPPED_S)
        assert balanced, f"the last report of {name} does not balance: {testbed.latest[name]}"


def restart(testbed: FaultTestbed, choice: random.Random, *, numbers: tuple[int, ...]) -> str:
    name, number = choice.choice((*NODES, "driver")), choice.choice(numbers)
    end(testbed, name, number)
    testbed.spin(choice.uniform(0, 1))
    testbed.start(name)
    return f"{name}, {signal.Signals(number).name}"


def pause(testbed: FaultTestbed, choice: random.Random) -> str:
    """Clouds must go on meanwhile where the process only listens, as a reliable subscriber that stops reading."""
    name = choice.choice((*NODES, "driver"))
    testbed[name].halt()
    try:
        testbed.spin(STOPPED_S)
        assert testbed[name].halted, f"{name} was not stopped"
        if name in SUFFIX:
            testbed.wait_for_cloud(CLOUD_S)
    finally:
        testbed[name].go_on()
    return name


def twins(testbed: FaultTestbed, choice: random.Random) -> str:
    testbed.run("second", node_command("reconstructor", "-r", "__node:=second"), is_node=True)
    testbed.wait_ready("second")
    testbed.clouds.clear()
    testbed.wait(lambda: len(testbed.clouds) > len(set(testbed.clouds)) + 3, "clouds of both")
    end(testbed, "second", choice.choice((signal.SIGKILL, signal.SIGTERM)))
    testbed.remove("second")
    return "two reconstructors"


def packets(testbed: FaultTestbed, choice: random.Random, *, fate: str, cause: str) -> str:
    """The driver does this to packets; the sketcher drops them for this cause, if any, and for no other.

    A busy machine drops some before they are read (queue), or leaves their frame too late.
    """
    before, counted = testbed.drive(), testbed.totals("sketcher")
    testbed.drive(**{fate: SHARE})
    testbed.spin(HELD_S)
    testbed.drive(**{fate: 0})
    testbed.spin(LATE_S)
    testbed.drive(sensor="")
    testbed.settle(["sketcher"])
    driver, sketcher = testbed.drive(sensor=testbed.sensor) - before, testbed.totals("sketcher") - counted
    done, dropped = driver[fate], sketcher[f"dropped.{cause}"]
    busy = {other: sketcher[f"dropped.{other}"] for other in {"queue", "late"} - {cause}}
    assert done and sketcher["dropped"] == dropped + sum(busy.values()), f"of {driver} {sketcher} came out"
    if cause:
        assert dropped == done or 0 < dropped < done and (any(busy.values()) or sketcher["message_lost"]), sketcher
    return f"{done} times"


def sensor(testbed: FaultTestbed, choice: random.Random, *, comes_back: bool) -> str:
    """Another size, T or IRF: from a driver that comes back, or in the middle of a frame."""
    name = choice.choice([name for name in SENSORS if name != testbed.sensor])
    testbed.spin(choice.uniform(0, 0.1))
    if comes_back:
        testbed["driver"].kill()
        testbed.sensor = name
        testbed.start("driver")
    else:
        testbed.drive(sensor=name)
    return name


def other_sensor(testbed: FaultTestbed, choice: random.Random) -> None:
    sensor(testbed, choice, comes_back=False)
    testbed.spin(HELD_S)


def windows(testbed: FaultTestbed, choice: random.Random) -> None:
    for frames in (5, choice.randint(2, 8), 1):
        testbed.set("sketcher", window_frames=frames)
        testbed.spin(HELD_S / 3)


def reports(testbed: FaultTestbed, choice: random.Random, **harm: str) -> None:
    testbed.drive(**harm)
    testbed.spin(HELD_S)
    testbed.drive(**{name: "" if name == "depth" else "good" for name in harm})


def moving(testbed: FaultTestbed, choice: random.Random, *, motion: str, harm: Callable, counted: str) -> str:
    """Something is wrong while a sensor moves: counted as this, if anything is, and costs no frame that is complete."""
    def begin(**parameters) -> None:
        end(testbed, "sketcher", signal.SIGTERM)
        testbed.start("sketcher", **parameters)

    def deskewed() -> None:
        before = testbed.totals("sketcher")["frames_deskewed"]
        testbed.wait(lambda: testbed.totals("sketcher")["frames_deskewed"] > before, "a deskewed frame", CLOUD_S)

    testbed.drive(odometry="good", imu="good")
    begin(motion=motion, extrinsics="0 0 0 0 0 0 1")
    deskewed()
    before = testbed.totals("sketcher")
    harm(testbed, choice)
    testbed.wait_for_cloud(CLOUD_S)
    deskewed()
    seen = testbed.totals("sketcher") - before
    testbed.drive(odometry="", imu="")
    begin()
    lost = seen["dropped"] - sum(seen[f"dropped.{cause}"] for cause in ("queue", "late", "incomplete"))
    assert (seen[counted] or not counted) and not lost, f"{harm}: {seen}"
    told = f"{seen[counted]} {counted}, " if counted else ""
    return f"{told}{seen['frames_undeskewed']} of {seen['frames_out']} frames undeskewed"


def by_odometry(harm: str, counted: str) -> Callable:
    return partial(moving, motion="odom", harm=partial(reports, odometry=harm), counted=counted)


FAULTS = {
    "kill": partial(restart, numbers=(signal.SIGKILL,)),
    "restart": partial(restart, numbers=(signal.SIGTERM, signal.SIGINT)),
    "stop": pause, "twins": twins,
    "lost": partial(packets, fate="lose", cause=""), "doubled": partial(packets, fate="double", cause="duplicate"),
    "late": partial(packets, fate="late", cause="late"), "cut": partial(packets, fate="cut", cause="malformed"),
    "sensor": partial(sensor, comes_back=True), "replaced": partial(sensor, comes_back=False),
    "odom_lost": by_odometry("", "frames_undeskewed"), "odom_late": by_odometry("late", "frames_undeskewed"),
    "odom_nan": by_odometry("nan", "motion_refused"), "odom_jump": by_odometry("jump", "motion_restarts"),
    "odom_leap": by_odometry("leap", "motion_restarts"),
    "imu_nan": partial(moving, motion="imu", harm=partial(reports, imu="nan"), counted="motion_refused"),
    "imu_fast": partial(moving, motion="imu", harm=partial(reports, imu="fast"), counted="motion_refused"),
    "depth_size": partial(moving, motion="estimate", harm=partial(reports, depth="size"), counted="motion_refused"),
    "depth_nan": partial(moving, motion="estimate", harm=partial(reports, depth="nan"), counted="frames_undeskewed"),
    "moving_replaced": partial(moving, motion="odom", harm=other_sensor, counted=""),
    "moving_window": partial(moving, motion="odom", harm=windows, counted=""),
}
COUNTED = ("lost", "doubled", "late", "cut")    # the sketcher, unharmed, accounts for every packet sent


@dataclass
class Round:
    fault: str
    did: str = ""
    recovery_s: float | None = None
    lost: Counter = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", nargs="+", choices=FAULTS, default=list(FAULTS), metavar="FAULT",
                        help=f"of {', '.join(FAULTS)}")
    parser.add_argument("--back-s", type=float, default=BACK_S, help="by when clouds must be back (%(default)g)")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    faults, rounds, folder = args.only, [], args.out.parent / "faults"
    with FaultTestbed(folder) as testbed:
        for number in tqdm(range(args.first, args.first + args.rounds), unit="round"):
            rounds.append(played := Round(faults[number % len(faults)]))
            play(testbed, played, random.Random(f"{args.seed}/{number}"), args.back_s)
            tqdm.write(f"round {number}, {played.fault}: {played.did or 'not done'}", file=sys.stderr)
            if played.problems or time.monotonic() > args.end_s:
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
    return verdicts, {"seed": args.seed, "rounds": len(rounds), "faults": summary}


def play(testbed: FaultTestbed, played: Round, choice: random.Random, back_s: float) -> None:
    """Do the round's fault and note what came of it."""
    replaced = len(testbed.replaced)
    testbed.misplaced.clear()
    try:
        testbed.drive(sensor="")
        testbed.settle(NODES)
        lost, came, sent = testbed.losses(), packets_counted(testbed), testbed.drive(sensor=testbed.sensor)
        testbed.wait_for_cloud(MAX_BACK_S)
        played.did = FAULTS[played.fault](testbed, choice)
        played.recovery_s = round(testbed.wait_for_cloud(max(MAX_BACK_S, back_s)), 3)
        if played.recovery_s > back_s:
            played.problems.append(f"clouds were back after {played.recovery_s:.1f} s")
        for name in SUFFIX:
            testbed.wait(lambda: testbed.probe.total(name, "frames_out"), f"{name} to record", CLOUD_S)
        sent = testbed.drive(sensor="") - sent
        played.problems += [f"{name}: {amount} frames are not accounted for: {testbed.latest.get(name)}"
                            for name, amount in testbed.settle(NODES).items()]
        if played.fault in COUNTED and (gone := sent["sent"] - (packets_counted(testbed) - came)):
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
