"""Fuzz every door: bytes made by mutation of real messages and files, guided by the code that they reach.

    .venv/bin/pip install atheris
    .venv/bin/python scripts/attacks/fuzz.py --door all

Each door (a codec, a file format, the parameters, the command line; --list names them) must read its input or refuse it
with one line that says what was expected: no other exception, no crash, at most a second of work of the process, at
most 256 MB of memory. What breaks that is kept, with the reason beside it, in build/attacks/fuzz/DOOR/, from where
--repeat FILE tries it again. The corpus that a run has found is where the next one begins. Ctrl-C ends a run; what was
tried until then is told and written all the same.

Exit code 0 if all of that holds for as many inputs as were asked for or fit into --minutes, 1 if not.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fuzz_doors
from result import write_result
from tqdm import tqdm

WORKER = Path(__file__).with_name("fuzz_worker.py")
COUNTS_BYTES = 24
MAX_RESTARTS = 5            # of a door whose process is ended by an input
POLL_S = 1.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--door", default="all", metavar="NAME,…", help="which (all)")
    parser.add_argument("--runs", type=int, metavar="N", help="inputs for each door; default: more for faster doors")
    parser.add_argument("--scale", type=float, default=1.0, metavar="X", help="of the default numbers (1)")
    parser.add_argument("--minutes", type=float, default=float("inf"), metavar="M", help="end after so long (never)")
    parser.add_argument("--seed", type=int, default=1, help="default: %(default)s")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="doors at a time (as many as cores)")
    parser.add_argument("--out", type=Path, default=Path("build/attacks/fuzz.json"), help="default: %(default)s")
    parser.add_argument("--fresh", action="store_true", help="forget the corpus of earlier runs")
    parser.add_argument("--list", action="store_true", help="name the doors and leave")
    parser.add_argument("--repeat", type=Path, metavar="FILE", help="try one input at --door and leave")
    args = parser.parse_args()
    doors = fuzz_doors.doors()
    chosen = list(doors) if args.door == "all" else args.door.split(",")
    if unknown := set(chosen) - set(doors):
        parser.error(f"--door is {', '.join(unknown)}: expected {', '.join(doors)}")
    if args.list:
        print("\n".join(chosen))
        return 0
    if args.repeat:
        return repeat(doors[chosen[0]], args.repeat.read_bytes())
    if importlib.util.find_spec("atheris") is None:
        parser.error(f"atheris is not installed: {sys.executable} -m pip install atheris")
    runs = {name: args.runs or max(round(doors[name].runs * args.scale), 1) for name in chosen}
    campaign = Campaign(runs, args.seed, args.out.parent / "fuzz", args.fresh)
    ended = campaign.attack(args.jobs, 60 * args.minutes)
    results = campaign.results()
    sound = all(one["defects"] == 0 for one in results.values())
    holds = sound and (ended == "minutes" or all(one["tried"] >= runs[name] for name, one in results.items()))
    tried = sum(one["tried"] for one in results.values())
    write_result(args.out, {"seed": args.seed, "ended_by": ended, "holds": holds, "tried": tried, "doors": results})
    for name, one in results.items():
        print(f"{name:15} {one['tried']:9,} tried  {one['read']:8,} read  {one['defects']:3} defects")
    print(f"{tried:,} inputs at {len(results)} doors: {'hold' if holds else 'FAIL'}; {args.out}")
    return not holds


class Campaign:
    """So many inputs at each of some doors, a process a door; what they leave lies in a folder a door."""

    def __init__(self, runs: dict[str, int], seed: int, folder: Path, fresh: bool):
        self.runs, self.seed, self.folder = runs, seed, folder
        self._stopped = False
        self._children: dict[str, subprocess.Popen] = {}
        for name in runs:
            if fresh:
                shutil.rmtree(folder / name, ignore_errors=True)
            (folder / name).mkdir(parents=True, exist_ok=True)
            for old in (path for path in (folder / name).iterdir() if path.is_file()):
                old.unlink()
            (folder / name / "counts").write_bytes(bytes(COUNTS_BYTES))

    def attack(self, jobs: int, seconds: float) -> str:
        """Try the inputs, so many doors at a time; what ended it: "runs", "minutes" or "Ctrl-C"."""
        end = time.monotonic() + seconds
        with ThreadPoolExecutor(jobs) as pool, tqdm(total=sum(self.runs.values()), unit="input", delay=2) as bar:
            pending = [pool.submit(self._attack_door, name) for name in self.runs]
            try:
                while not all(one.done() for one in pending):
                    if time.monotonic() > end:
                        return "minutes"
                    time.sleep(POLL_S)
                    bar.update(sum(self._counts(name)[0] for name in self.runs) - bar.n)
            except KeyboardInterrupt:
                return "Ctrl-C"
            finally:
                self._stopped = True
                for child in list(self._children.values()):
                    child.terminate()
            for one in pending:
                one.result()
        return "runs"

    def results(self) -> dict[str, dict[str, int]]:
        """By door: inputs that were tried, that could be read, and that are defects."""
        return {name: self._result(name) for name in self.runs}

    def _attack_door(self, name: str) -> None:
        """An input that ends the process ends it for itself only: the next one goes on with another seed."""
        for attempt in range(MAX_RESTARTS):
            left = self.runs[name] - self._counts(name)[0]
            if left <= 0 or self._stopped:
                return
            with open(self.folder / name / "log.txt", "ab") as log:
                self._children[name] = subprocess.Popen(
                    [sys.executable, str(WORKER), name, str(left), str(self.seed + attempt), str(self.folder / name)],
                    stdout=log, stderr=log)
                if self._stopped:       # meanwhile
                    self._children[name].terminate()
                self._children[name].wait()

    def _counts(self, name: str) -> tuple[int, int, int]:
        raw = (self.folder / name / "counts").read_bytes()
        return tuple(int.from_bytes(raw[at:at + 8], "little") for at in (0, 8, 16))

    def _result(self, name: str) -> dict[str, int]:
        tried, was_read, defects = self._counts(name)
        ended = sum(1 for kind in ("crash", "timeout", "oom", "leak") for _ in (self.folder / name).glob(f"{kind}-*"))
        return {"tried": tried, "read": was_read, "defects": defects + ended}


def repeat(door: fuzz_doors.Door, raw: bytes) -> int:
    """Try one input; 1 and why if it is a defect."""
    read, _ = door.make()
    try:
        print(f"{door.name}: {'read' if fuzz_doors.knock(door, read, raw) else 'refused'}")
    except fuzz_doors.Defect as defect:
        print(defect)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
