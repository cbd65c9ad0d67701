"""From the command's options to results, tables and a figure."""

import argparse
import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from srt3d_ros.benchmark.plan import FULL, PARTS, QUICK, PartFailed, Plan
from srt3d_ros.benchmark.progress import Progress
from srt3d_ros.benchmark.results import Results, machine_slug
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sensor import SensorModel

FAILED, INTERRUPTED = 1, 130


def benchmark(args: argparse.Namespace) -> int:
    """Run `srt3d benchmark`; returns the exit code."""
    plan = replace(QUICK if args.quick else FULL, device=device_of(args.device))
    if args.repeats is not None:
        plan = replace(plan, repeats=args.repeats)
    args.out.mkdir(parents=True, exist_ok=True)
    stem = machine_slug(plan.device) + "-quick" * args.quick
    results = Results(args.out / f"{stem}.jsonl")
    chosen = [part for part in PARTS if part in (args.parts or PARTS)]
    code = 0
    for number, part in enumerate(chosen, start=1):
        try:
            measure(part, plan, results, f"{number}/{len(chosen)} {part}")
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


def device_of(wanted: str) -> str:
    """The device that is meant, or InvalidInput if it cannot be had."""
    smallest = SensorModel(rows=4, cols=4, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))
    return METHODS["pooled"].build(smallest, (1, 2), device=wanted).device


def measure(part: str, plan: Plan, results: Results, title: str) -> None:
    """Measure a part, each line of it to the results at once."""
    module = importlib.import_module(f"srt3d_ros.benchmark.{part}")
    notes: list[str] = []

    def note(text: str) -> None:
        if text not in notes:
            notes.append(text)
            Progress.write(f"srt3d: {part}: {text}", file=sys.stderr)

    with Progress(title, module.steps(plan)) as bar:
        for line in module.measure(plan, bar, note):
            results.append(part, line)
        bar.says("done")
        bar.update(bar.total)


def show(part: str, results: Results, picture: Path) -> None:
    """The part's table, its picture if it has one, and where the results are."""
    module, lines = importlib.import_module(f"srt3d_ros.benchmark.{part}"), results.lines.get(part)
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
