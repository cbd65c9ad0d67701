"""From the command's options to results, tables and a figure."""

import argparse
import importlib
import sys
from dataclasses import replace
from pathlib import Path

from srt3d_ros.benchmark.plan import FULL, PARTS, QUICK, PartFailed, Plan
from srt3d_ros.benchmark.results import Results, machine_slug
from srt3d_ros.benchmark.timing import Progress
from srt3d_ros.core.device import kernels_for

FAILED, INTERRUPTED = 1, 130


def benchmark(args: argparse.Namespace) -> int:
    """Run `srt3d benchmark`; returns the exit code."""
    device, _ = kernels_for(args.device)
    plan = replace(QUICK if args.quick else FULL, device=device, photons=tuple(args.bytes or ()),
                   tolerance=args.tolerance)
    if args.repeats is not None:
        plan = replace(plan, repeats=args.repeats)
    args.out.mkdir(parents=True, exist_ok=True)
    stem = machine_slug(plan.device) + "-quick" * args.quick
    results = Results(args.out / f"{stem}.jsonl")
    asked = [*args.parts, *(["bytes"] if args.bytes is not None else [])]
    chosen = [part for part in PARTS if part in (asked or PARTS)]
    code = 0
    for number, part in enumerate(chosen, start=1):
        try:
            measure(part, plan, results, f"{number}/{len(chosen)}")
        except KeyboardInterrupt:
            print("srt3d: interrupted: the results have what was measured until then", file=sys.stderr)
            code = INTERRUPTED
        except PartFailed as failed:
            for problem in failed.args[0]:
                print(f"srt3d: {part}: {problem}", file=sys.stderr)
            code = FAILED
        show(part, results, args.out / f"{stem}-{part}.png")
        if code == INTERRUPTED:
            break
    return code


def measure(part: str, plan: Plan, results: Results, place: str) -> None:
    """Measure a part, each line of it to the results at once."""
    with Progress(part, place) as bar:
        for line in _module(part).measure(plan, bar):
            results.append(part, line)
        bar.show("done")


def show(part: str, results: Results, picture: Path) -> None:
    """Print the part's table and where the results are; draw its picture if it has one."""
    module, lines = _module(part), results.lines.get(part)
    if not lines:
        return
    last = lines[-1]
    gpu = next((f"{line['gpu']}, " for line in lines if "gpu" in line), "")
    print(f"\n{module.TITLE}\n{gpu}{last['cpus']} × {last['machine']}, load {last['load_1min']}, {last['date']}\n")
    print(module.table(lines), flush=True)
    written = [results.path]
    if hasattr(module, "draw"):
        try:
            module.draw(picture, lines)
            written.append(picture)
        except ModuleNotFoundError as error:
            print(f"srt3d: {part}: no picture: {error.name} is not installed", file=sys.stderr)
    print(f"\n{'  '.join(map(str, written))}\n", flush=True)


def _module(part: str):
    """That of a part: TITLE, measure(plan, bar) gives lines, table(lines) shows them, and some draw(path, lines)."""
    return importlib.import_module(f"srt3d_ros.benchmark.{part}")
