"""Harm a running pipeline, round after round: it recovers, its frame accounting adds up, and nothing is broken.

    .venv/bin/python scripts/attacks/faults.py [--rounds 200] [--seed 1] [--only FAULT …] [--first ROUND]

Sketcher, reconstructor, recorder and bag recorder run as processes, fed by a driver of raw packets, four a frame. A
round picks a fault, does it, sees that it was done, takes it back, and passes if

- clouds are back within 3 s: those of photons that came after the fault was over, or after the process was ready that
  replaces one that was killed, with a point in nine of ten pixels;
- no cloud at any time showed the scene where it is not;
- nothing ended that was not ended on purpose, and nobody wrote a traceback;
- the frame accounting of every node adds up, and what the driver sent is what the sketcher counted, where neither was
  harmed;
- recordings and bags that were finished open, and those that were cut off are repaired or refused in one line.

A round that fails leaves its logs beside the result, and the pipeline is started anew. Faults of the disk and of shared
memory need root or user namespaces: the campaign has disks of its own, which nobody else sees.
"""

import argparse
import os
import random
import statistics
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

import faults_data
import faults_machine
import faults_nodes
import faults_picture
import machine
from faulty import RECORDERS, FaultyStack, inspect
from process import REPOSITORY, Process
from result import write_result
from srt3d_ros.cli.processes import join_private_network
from tqdm import tqdm

OF_NODES = (faults_nodes.kill, faults_nodes.stop, faults_nodes.restart, faults_nodes.twins, faults_nodes.reader,
            faults_nodes.lifecycle, faults_nodes.parameters)
OF_DATA = (faults_data.lost, faults_data.doubled, faults_data.late, faults_data.shuffled, faults_data.sensor,
           faults_data.replaced, faults_data.clock)
OF_MACHINE = (faults_machine.disk_full, faults_machine.disk_read_only, faults_machine.shared_memory_full,
              faults_machine.shared_memory_leaked)
FAULTS = {fault.__name__: fault for fault in (*OF_NODES, *OF_DATA, *OF_MACHINE)}
BOOKKEEPERS = ("sketcher", "reconstructor", "recorder", "bag_recorder")
PATIENCE_S = 30.0               # at least, for which clouds are waited that have to be back earlier
CLEAR_S = 30.0
RESULT = REPOSITORY / "build" / "attacks" / "faults.json"


@dataclass
class Round:
    """What came of a round."""

    number: int
    fault: str
    seconds: float = 0.0
    recovery_s: float | None = None
    evidence: dict = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


class Campaign:
    """Rounds one after the other on the same pipeline, until one fails; then on another.

    Args:
        faults: names of those to pick from.
        folder: for logs of rounds that fail, and for all that the nodes write.
        own_mounts: whether disks and shared memory of its own can be had.
        back_s: by when clouds have to be back.
    """

    def __init__(self, seed: int, faults: list[str], folder: Path, own_mounts: bool, back_s: float):
        self._seed, self._faults, self._folder, self._own_mounts = seed, faults, folder, own_mounts
        self._back_s = back_s
        self._stack: FaultyStack | None = None
        self._looks: list[tuple[Round, str, Path, bool, Process]] = []

    def play(self, number: int) -> Round:
        """One round; the same number is the same fault."""
        choice = random.Random(f"{self._seed}/{number}")
        played, began = Round(number, choice.choice(self._faults)), time.monotonic()
        try:
            if self._stack is None:
                self._stack = FaultyStack(self._folder / "run", self._own_mounts)
                self._stack.__enter__()
                self._stack.wait_for_cloud(CLEAR_S)
                self._stack.drive(sensor="")
                self._stack.settle(BOOKKEEPERS)
            self._harm(played, choice)
        except (AssertionError, TimeoutError) as problem:
            played.problems.append(str(problem))
        if self._stack is not None:
            self._look(played)
        if played.problems:
            self.end(played)
        played.seconds = round(time.monotonic() - began, 2)
        return played

    def _harm(self, played: Round, choice: random.Random) -> None:
        stack = self._stack
        stack.ended.clear()
        stack.misplaced.clear()
        lost, sent = stack.counts.losses(), stack.drive()
        came = self._came()
        stack.resume()
        stack.wait_for_cloud(CLEAR_S)
        played.evidence = FAULTS[played.fault](stack, choice)
        intact = played.evidence.pop("intact", False)
        played.recovery_s = round(stack.wait_for_cloud(max(PATIENCE_S, self._back_s)), 3)
        if played.recovery_s > self._back_s:
            played.problems.append(f"clouds were back after {played.recovery_s:.1f} s")
        for name in {name for name, _ in stack.ended} & RECORDERS.keys():
            stack.wait(lambda: stack.value(name, "frames_out") not in ("", "0"), f"{name} to record")
        now = stack.drive(sensor="")
        unbalanced = stack.settle(BOOKKEEPERS)
        played.problems += [f"{name}: {amount} frames are not accounted for: {stack.counts.latest.get(name)}"
                            for name, amount in unbalanced.items()]
        if intact and (gone := (now - sent)["sent"] - (self._came() - came)):
            played.problems.append(f"{gone} of {(now - sent)['sent']} packets are not accounted for")
        played.lost = dict(stack.counts.losses() - lost)
        played.problems += [f"a cloud at {seen.median_m:.2f} m" for seen in stack.misplaced[:3]]
        played.problems += stack.dead()
        processes = [*stack.ended, *stack.processes.items()]
        played.problems += [f"{name} wrote a traceback" for name, process in processes if "Traceback" in process.text]

    def _came(self) -> int:
        """Packets that the sketcher had, or knows that it missed."""
        counted = self._stack.counts.totals("sketcher")
        return counted["frames_in"] + counted["message_lost"]

    def _look(self, played: Round) -> None:
        """Begin to look at what was recorded; what is wrong with it is told of the round that made it."""
        for name, path, whole in self._stack.recorded:
            self._looks.append((played, name, path, whole, inspect(name, path)))
        self._stack.recorded.clear()
        self._finish_looks(must=False)

    def _finish_looks(self, must: bool) -> None:
        for look in list(self._looks):
            played, name, path, whole, process = look
            if process.running and not must:
                continue
            code = process.code(300.0)
            refused = code == 2 and len(process.lines) == 1 and name == "bag_recorder"
            if "Traceback" in process.text or not (code == 0 or refused and not whole):
                played.problems.append(f"{path} does not open: {process.text}")
            else:
                for file in path.parent.glob(f"{path.stem}_repaired*"):
                    file.unlink()
            self._looks.remove(look)

    def end(self, failed: Round | None = None) -> None:
        """End the pipeline; keep its logs if a round failed."""
        if (stack := self._stack) is None:
            return
        self._stack = None
        stack.__exit__()
        for name in RECORDERS.keys() & stack.processes.keys():
            stack.note_recorded(name)
        if failed is not None:
            _keep_logs(self._folder / f"round_{failed.number:03}", stack)
        last = failed or Round(-1, "the end")
        self._looks += [(last, name, path, whole, inspect(name, path)) for name, path, whole in stack.recorded]
        self._finish_looks(must=True)
        stack.close()
        if last.number < 0 and last.problems:
            raise SystemExit("\n".join(last.problems))


def _keep_logs(folder: Path, stack: FaultyStack) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, (name, process) in enumerate([*stack.ended, *stack.processes.items()]):
        (folder / f"{k}_{name}.log").write_text(f"{' '.join(process.command)}\n{process.text}\n")


def table(rounds: list[Round]) -> str:
    """A line a fault."""
    lines = [f"{'fault':22}{'rounds':>7}{'failed':>7}{'median s':>10}{'max s':>8}  frames lost, by cause"]
    for name in FAULTS:
        of = [played for played in rounds if played.fault == name]
        times = [played.recovery_s for played in of if played.recovery_s is not None]
        lost = sum((Counter(played.lost) for played in of), Counter())
        causes = ", ".join(f"{n} {cause}" for cause, n in lost.most_common())
        if of:
            figures = f"{statistics.median(times):10.2f}{max(times):8.2f}" if times else f"{'-':>10}{'-':>8}"
            lines.append(f"{name:22}{len(of):7}{sum(bool(played.problems) for played in of):7}{figures}  {causes}")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first round, to repeat one")
    parser.add_argument("--only", nargs="+", choices=FAULTS, help="the faults to pick from")
    parser.add_argument("--back-s", type=float, default=faults_picture.BACK_S, help="by when clouds have to be back")
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument("--picture", type=Path, help="recovery times, such as docs/images/faults.svg")
    args = parser.parse_args()
    why_not = machine.have_own_mounts()
    if "ROS_DOMAIN_ID" not in os.environ:
        join_private_network()
    left_out = [fault.__name__ for fault in OF_MACHINE] if why_not else []
    faults = [name for name in args.only or FAULTS if name not in left_out]
    if left_out:
        print(f"left out: {', '.join(left_out)}, as {why_not}", file=sys.stderr)
    campaign = Campaign(args.seed, faults, args.out.parent / "faults", not why_not, args.back_s)
    rounds, began = [], time.monotonic()
    try:
        for number in tqdm(range(args.first, args.first + args.rounds), unit="round"):
            rounds.append(campaign.play(number))
            for problem in rounds[-1].problems:
                tqdm.write(f"round {number}, {rounds[-1].fault} {rounds[-1].evidence}: {problem}")
    except KeyboardInterrupt:
        print(f"stopped after {len(rounds)} of {args.rounds} rounds", file=sys.stderr)
    finally:
        campaign.end()
    failed = [played for played in rounds if played.problems]
    write_result(args.out, {"seed": args.seed, "seconds": round(time.monotonic() - began, 1), "left_out": left_out,
                          "failed": len(failed), "rounds": [asdict(played) for played in rounds]})
    if args.picture:
        faults_picture.draw(rounds, args.picture)
    print(table(rounds))
    for played in failed:
        only = f" --only {' '.join(args.only)}" if args.only else ""
        print(f"to repeat: faults.py --seed {args.seed} --first {played.number} --rounds 1{only}; "
              f"logs: {args.out.parent / 'faults' / f'round_{played.number:03}'}")
    print(f"{len(rounds) - len(failed)} of {len(rounds)} rounds passed in {time.monotonic() - began:.0f} s")
    return bool(failed) or len(rounds) < args.rounds


if __name__ == "__main__":
    sys.exit(main())
