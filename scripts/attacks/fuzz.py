"""Fuzz every door: bytes made by mutation of real messages and files, guided by the code that they reach.

    .venv/bin/pip install atheris
    .venv/bin/python scripts/attacks/fuzz.py --door all

Each door (a codec, a file format, the parameters, the command line; --list names them) must read its input or refuse it
with one line that says what was expected: no other exception, no crash, at most a second of work of the process, at
most 256 MB of memory. What breaks that is kept, with the reason beside it, in build/attacks/fuzz/DOOR/, from where
--repeat FILE tries it again. The corpus that a run has found is where the next one begins.

Exit code 0 if all of that holds, 1 if not.
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
    results = attack(runs, args.seed, args.jobs, args.out.parent / "fuzz", args.fresh)
    holds = all(one["defects"] == 0 and one["tried"] >= runs[name] for name, one in results.items())
    tried = sum(one["tried"] for one in results.values())
    write_result(args.out, {"seed": args.seed, "holds": holds, "tried": tried, "doors": results})
    for name, one in results.items():
        print(f"{name:15} {one['tried']:9,} tried  {one['read']:8,} read  {one['defects']:3} defects")
    print(f"{tried:,} inputs at {len(results)} doors: {'hold' if holds else 'FAIL'}; {args.out}")
    return not holds


def attack(runs: dict[str, int], seed: int, jobs: int, folder: Path, fresh: bool) -> dict[str, dict[str, int]]:
    """Try so many inputs at each door; what came of it."""
    for name in runs:
        if fresh:
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir(parents=True, exist_ok=True)
        for old in (path for path in (folder / name).iterdir() if path.is_file()):
            old.unlink()
        (folder / name / "counts").write_bytes(bytes(COUNTS_BYTES))
    with ThreadPoolExecutor(jobs) as pool, tqdm(total=sum(runs.values()), unit="input", delay=2) as bar:
        pending = [pool.submit(_attack_door, name, count, seed, folder / name) for name, count in runs.items()]
        while not all(one.done() for one in pending):
            time.sleep(POLL_S)
            bar.update(sum(_counts(folder / name)[0] for name in runs) - bar.n)
        for one in pending:
            one.result()
    return {name: _result(folder / name) for name in runs}


def repeat(door: fuzz_doors.Door, raw: bytes) -> int:
    """Try one input; 1 and why if it is a defect."""
    read, _ = door.make()
    try:
        print(f"{door.name}: {'read' if fuzz_doors.knock(door, read, raw) else 'refused'}")
    except fuzz_doors.Defect as defect:
        print(defect)
        return 1
    return 0


def _attack_door(name: str, runs: int, seed: int, folder: Path) -> None:
    """An input that ends the process ends it for itself only: the next one goes on with another seed."""
    for attempt in range(MAX_RESTARTS):
        left = runs - _counts(folder)[0]
        if left <= 0:
            return
        with open(folder / "log.txt", "ab") as log:
            subprocess.run([sys.executable, str(WORKER), name, str(left), str(seed + attempt), str(folder)],
                           stdout=log, stderr=log, check=False)


def _counts(folder: Path) -> tuple[int, int, int]:
    raw = (folder / "counts").read_bytes()
    return tuple(int.from_bytes(raw[at:at + 8], "little") for at in (0, 8, 16))


def _result(folder: Path) -> dict[str, int]:
    tried, was_read, defects = _counts(folder)
    ended = sum(1 for kind in ("crash", "timeout", "oom", "leak") for _ in folder.glob(f"{kind}-*"))
    return {"tried": tried, "read": was_read, "defects": defects + ended}


if __name__ == "__main__":
    sys.exit(main())
