"""What the constants of `pooled` are worth: quality and time with each halved, doubled and, where it can be, off.

    python -m benchmarks ablation                               # everything: hours on two cores
    python -m benchmarks ablation --constants PRIOR_VOTE,SPREAD --only "bust*,room_64_2_50"

Prints a Markdown table with a row per variant: mean change over the cases (ablation_cases.py), and the case that loses
most. There is a line for each variant, with every number of every case; what the file of --out has already of this code
is not measured again.
"""

import argparse
import ast
import hashlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from benchmarks.ablation_cases import SIMULATED, load_sketches, names_of, open_trial, reconstruct, save_sketches
from srt3d_ros.kernels import constants

REPOSITORY = Path(__file__).resolve().parents[1]
QUALITY = ("td_percent", "fd_percent", "dae_bins", "iae", "within_1_std_percent", "held_out_nats", "points")
METRICS = (*QUALITY, "cpu_ms")
UNITS = {"td_percent": " %", "fd_percent": " %", "dae_bins": " bins", "iae": "", "within_1_std_percent": " %",
         "held_out_nats": ""}                   # of the table's columns
FIXED = ("MAX_SKETCH_SIZE", "MAX_PHOTONS",      # limits
         "FINE", "CELL", "RIDGE",               # the grid of the pool, which fits together, and rounding
         "INTENSITY_RATE", "APSS_*",            # of the baselines
         "STAY")                                # of warm_start
NONE, ANY = 0, 1e6
OFF = {"FAINTEST": NONE, "APART": -1, "WEAK": NONE, "LEAST_SHARE": NONE, "DEAD_PIXEL": -ANY, "LIKENESS": ANY,
       "VOTE_SIGMA": ANY, "PRIOR_VOTE": NONE, "MAX_VOTE": ANY, "EMPTY_PENALTY": NONE, "FEWER_PENALTY": NONE,
       "BIRTH": NONE, "JUDGED": 1, "RESOLVED": NONE, "SPREAD": NONE}
MOST = {"WINDOWS[:, 1]": 16}                    # beyond this margin kernels read other memory
Rows = dict[str, dict]                          # the metrics of each case, or {"failed": why}


@dataclass(frozen=True)
class Variant:
    """The default, one constant with another value, or other options of the method."""

    label: str
    name: str = ""
    value: object = None
    options: dict = field(default_factory=dict)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared/data/photons", metavar="DIR",
                        help="folder of photon files, *.npz (%(default)s)")
    parser.add_argument("--constants", type=words, default=["*"], metavar="A,B",
                        help="only these, or the option warm_start; * and ? as in file names; '' for none")
    parser.add_argument("--only", type=words, default=["*"], metavar="CASE,…",
                        help="only these cases, such as two_layer_100, bust_1_10 or 'bust*'")
    parser.add_argument("--jobs", type=int, default=2, metavar="N",
                        help="processes at a time, of one thread each (%(default)s)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="timed runs of each frame (%(default)s)")


def words(text: str) -> list[str]:
    return text.split(",")


def run(args: argparse.Namespace) -> Iterator[dict]:
    variants, cases, code = [Variant("default"), *chosen(args.constants)], names_of(args.data, args.only), digest()
    if not cases:
        sys.exit(f"--only {','.join(args.only)}: expected the name of a case, such as bust_1_10")
    rows: dict[str, Rows] = {variant.label: {} for variant in variants}
    if args.out and args.out.exists():
        for line in map(json.loads, args.out.read_text(encoding="utf-8").splitlines()):
            if line["code"] == code:
                rows.setdefault(line["variant"], {}).update(line["cases"])
    with TemporaryDirectory() as folder, ThreadPoolExecutor(args.jobs) as pool:
        save_sketches(cases, args.data, Path(folder))
        futures = {}
        for variant in variants:
            missing = [case for case in cases if case not in rows[variant.label]
                       and (case in SIMULATED or not variant.options)]
            if missing:
                futures[pool.submit(measure_apart, variant, missing, folder, args)] = variant.label
        try:
            for future in tqdm(as_completed(futures), total=len(futures), unit="variant"):
                rows[futures[future]] |= future.result()
                yield {"code": code, "variant": futures[future], "cases": future.result()}
        finally:
            pool.shutdown(cancel_futures=True)
    print(table(variants, cases, rows))


def digest() -> str:
    """Of the sources that decide what is measured."""
    files = sorted(file for part in ("core", "kernels") for file in (REPOSITORY / "srt3d_ros" / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def chosen(patterns: list[str]) -> list[Variant]:
    """Each number of each constant halved, doubled and off, and warm_start, as far as a pattern names it."""
    varied = [variant for name, value in vars(constants).items()
              if name.isupper() and not any(fnmatch(name, pattern) for pattern in FIXED)
              for variant in variants_of(name, value)]
    varied.append(Variant("warm_start", "warm_start", options={"warm_start": True}))
    for pattern in filter(None, patterns):
        if not any(fnmatch(variant.name, pattern) for variant in varied):
            names = ", ".join(dict.fromkeys(variant.name for variant in varied))
            sys.exit(f"--constants {pattern}: expected some of {names}")
    return [variant for variant in varied if any(fnmatch(variant.name, pattern) for pattern in patterns)]


def variants_of(name: str, value) -> list[Variant]:
    """The variants of a number, or of each column of a table; one that equals the default or another is left out."""
    columns = list(zip(*value)) if isinstance(value, tuple) else [(value,)]
    variants = []
    for k, numbers in enumerate(columns):
        part, tried = f"{name}[:, {k}]" if isinstance(value, tuple) else name, [numbers]
        changes = [half, lambda number: 2 * number]
        changes += [lambda number: type(number)(OFF[part])] if part in OFF else []
        for change in changes:
            new = tuple(min(change(number), MOST.get(part, math.inf)) for number in numbers)
            if new not in tried:
                tried.append(new)
                label = " → ".join(", ".join(f"{number:g}" for number in several) for several in (numbers, new))
                changed = tuple(zip(*columns[:k], new, *columns[k + 1:])) if isinstance(value, tuple) else new[0]
                variants.append(Variant(f"{part}: {label}", name, changed))
    return variants


def half(number):
    """Half of it; of an integer at least 1."""
    return max(1, round(number / 2)) if isinstance(number, int) else number / 2


def measure_apart(variant: Variant, cases: list[str], folder: str, args) -> Rows:
    """The rows from a process of its own, which compiles all kernels with the variant's constant."""
    task = {"name": "" if variant.options else variant.name, "value": variant.value, "options": variant.options,
            "data": str(args.data), "folder": folder, "cases": cases, "repeats": args.repeats}
    with TemporaryDirectory(dir=folder) as cache:
        environment = {"NUMBA_CACHE_DIR": cache, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        done = subprocess.run([sys.executable, "-m", "benchmarks.ablation", repr(task)], cwd=REPOSITORY,
                              env=os.environ | environment, capture_output=True, text=True)
    if done.returncode == 0:
        return json.loads(done.stdout.splitlines()[-1])
    failed = f"exit code {done.returncode}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}"
    if variant.label == "default":
        raise RuntimeError(f"the default fails: {failed}")
    return {case: {"failed": failed.replace("|", "/")[:120]} for case in cases}


def measure(task: dict) -> None:
    """What the process of a variant does: set the constant before any module reads it, then reconstruct."""
    if task["name"]:
        setattr(constants, task["name"], task["value"])
    print(json.dumps({case: reconstruct(open_trial(case, Path(task["data"])), load_sketches(case, Path(task["folder"])),
                                        task["options"], task["repeats"]) for case in task["cases"]}))


def table(variants: list[Variant], cases: list[str], rows: dict[str, Rows]) -> str:
    """Markdown: the means of the default, and what each variant changes."""
    before = numbers(rows["default"], cases)
    means = [f"{value:.2f}{unit}" if np.isfinite(value := mean(before[metric])) else "–"
             for metric, unit in UNITS.items()]
    lines = [f"Cases: {', '.join(cases)}. Mean changes against the default; CPU time of all cases. Worst: the greatest "
             "sum of points of TD lost, points of FD gained and % of DAE gained, or % of nats lost.\n",
             "| variant | TD, points | FD, points | DAE, % | IAE, % | within 1 std, points | nats / 100 pixels | "
             "time, % | worst case: TD / FD / DAE |", "|---" * 9 + "|",
             f"| default | {' | '.join(means)} | {before['cpu_ms'].sum():.0f} ms | |"]
    for variant in variants[1:]:
        measured = [case for case in cases if case in rows[variant.label]]
        failed = next((row["failed"] for row in rows[variant.label].values() if "failed" in row), "")
        if failed or not measured:
            cells = [f"fails: {failed}" if failed else "none of these cases", *[""] * 7]
        else:
            cells = changes(numbers(rows["default"], measured), numbers(rows[variant.label], measured), measured)
        lines.append(f"| {variant.label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def changes(before: dict[str, np.ndarray], after: dict[str, np.ndarray], cases: list[str]) -> list[str]:
    """The cells of a variant's row."""
    td, fd, within, nats = (after[metric] - before[metric] for metric in (
        "td_percent", "fd_percent", "within_1_std_percent", "held_out_nats"))
    dae, iae = (100 * (after[metric] - before[metric]) / np.maximum(before[metric], 1e-9)
                for metric in ("dae_bins", "iae"))
    losses = sum(np.maximum(np.nan_to_num(loss), 0)
                 for loss in (-td, fd, dae, -100 * nats / np.abs(before["held_out_nats"])))
    worst = int(losses.argmax())
    text = f"{cases[worst]}: " + (f"{signed(nats[worst])} nats" if np.isfinite(nats[worst]) else
                                  f"{signed(td[worst])} / {signed(fd[worst])} / {signed(dae[worst], 1)} %")
    if losses[worst] == 0:
        same = all(np.array_equal(before[metric], after[metric], equal_nan=True) for metric in QUALITY)
        text = "nothing changes" if same else "none is worse in these"
    time = 100 * (after["cpu_ms"].sum() / before["cpu_ms"].sum() - 1)
    return [*(signed(mean(change)) for change in (td, fd, dae, iae, within, nats)), signed(time, 0), text]


def numbers(rows: Rows, cases: list[str]) -> dict[str, np.ndarray]:
    """Each metric of all cases, NaN where a case has none."""
    return {metric: np.array([rows[case].get(metric, np.nan) for case in cases]) for metric in METRICS}


def mean(values: np.ndarray) -> float:
    """Of those that are not NaN."""
    return float(np.nanmean(values)) if not np.isnan(values).all() else float("nan")


def signed(value: float, digits: int = 2) -> str:
    return f"{value:+.{digits}f}".replace("-", "−") if np.isfinite(value) else "–"


if __name__ == "__main__":
    measure(ast.literal_eval(sys.argv[1]))
