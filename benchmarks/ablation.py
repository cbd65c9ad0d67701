"""What the constants of `pooled` are worth: quality and time with each halved, doubled and, where it can be, off.

    PYTHONPATH=. python benchmarks/ablation.py                              # everything: about an hour on two cores
    PYTHONPATH=. python benchmarks/ablation.py --constants BELIEF,VOTES --only "bust*,room_64_2_50"

Prints a Markdown table with a row per variant: mean change over the cases (ablation_cases.py), and the case that loses
most. The file of `--csv` keeps every number of every case; what is there already is not measured again.
"""

import argparse
import ast
import csv
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from ablation_variants import FEATURES, Variant, variants_of_constants
from tqdm import tqdm

REPOSITORY = Path(__file__).resolve().parents[1]
QUALITY = ("td_percent", "fd_percent", "dae_bins", "iae", "within_1_std_percent", "held_out_nats", "points")
METRICS = (*QUALITY, "cpu_ms")
UNITS = {"td_percent": " %", "fd_percent": " %", "dae_bins": " bins", "iae": "", "within_1_std_percent": " %",
         "held_out_nats": ""}                   # of the table's columns
TIMEOUT_S = 1800
MEASURE = "--measure"                           # how this file starts itself for a variant


def main() -> None:
    from ablation_cases import names_of

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared/data/photons", metavar="DIR",
                        help="folder of photon files, *.npz (%(default)s)")
    parser.add_argument("--csv", type=Path, default=REPOSITORY / "build/ablation.csv", metavar="FILE",
                        help="every number of every case; continued if it exists (%(default)s)")
    parser.add_argument("--fresh", action="store_true", help="forget what is in that file")
    parser.add_argument("--constants", type=words, default=["*"], metavar="A,B",
                        help="only these; * and ? as in file names; '' for none")
    parser.add_argument("--only", type=words, default=["*"], metavar="CASE,…",
                        help="only these cases, such as two_layer_100, bust_1_10 or 'bust*'")
    parser.add_argument("--features", action="store_true",
                        help="also features that are off by default: " + ", ".join(name for name, _ in FEATURES))
    parser.add_argument("--jobs", type=int, default=2, metavar="N",
                        help="processes at a time, of one thread each (%(default)s)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="timed runs of each frame (%(default)s)")
    parser.add_argument("--compile-all", action="store_true",
                        help="compile all kernels for each variant, not only those that its constant may reach")
    args = parser.parse_args()
    results = Results(args.csv, args.fresh)
    variants = [Variant("default"), *variants_of_constants(args.constants)]
    variants += [Variant(name, options=options) for name, options in FEATURES if args.features]
    if not any(args.data.glob("*.npz")):
        print(f"no photon files in {args.data}: simulated scenes only", file=sys.stderr)
    cases = names_of(args.data, args.only)
    if not cases:
        sys.exit(f"--only {','.join(args.only)}: expected the name of a case, such as bust_1_10")
    with TemporaryDirectory() as folder:
        measure_all(variants, cases, results, Path(folder), args)
    print(table(variants, cases, results))


def words(text: str) -> list[str]:
    return text.split(",")


class Results:
    """A CSV file with a row for each variant and case."""

    def __init__(self, path: Path, fresh: bool):
        self._path, self._code, self._rows = path, digest(), {}
        if path.exists() and not fresh:
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
            if any(row["code"] != self._code for row in rows):
                sys.exit(f"{path} was measured with other code: expected --fresh, or another --csv")
            self._rows = {(row["variant"], row["case"]): row for row in rows}

    def get(self, variant: Variant, case: str) -> dict | None:
        return self._rows.get((variant.label, case))

    def add(self, variant: Variant, rows: dict[str, dict]) -> None:
        """Keep rows by case, in the file too."""
        self._rows |= {(variant.label, case): {"code": self._code, "variant": variant.label, "case": case} | row
                       for case, row in rows.items()}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("w", newline="") as file:
            writer = csv.DictWriter(file, ("code", "variant", "case", *METRICS, "failed"))
            writer.writeheader()
            writer.writerows(self._rows.values())


def digest() -> str:
    """Of the sources that decide what is measured."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in source_files())).hexdigest()[:12]


def source_files() -> list[Path]:
    return sorted(file for part in ("core", "kernels") for file in (REPOSITORY / "srt3d_ros" / part).rglob("*.py"))


def measure_all(variants: list[Variant], cases: list[str], results: Results, folder: Path, args) -> None:
    """Measure what is not in the results yet; the kernels of the default are compiled before, for all to share."""
    from ablation_cases import SIMULATED, save_sketches

    def run(variant: Variant) -> tuple[Variant, dict]:
        return variant, measure_apart(variant, todo[variant.label], folder, args)

    todo = {variant.label: [case for case in cases if results.get(variant, case) is None
                            and ("warm_start" not in variant.options or case in SIMULATED)] for variant in variants}
    waiting = [variant for variant in variants if todo[variant.label]]
    if not waiting:
        return
    save_sketches(cases, args.data, folder)
    with (tqdm(total=len(waiting), unit="variant", desc="compiling", mininterval=0.1 if sys.stderr.isatty() else 5.0)
          as bar, ThreadPoolExecutor(args.jobs) as pool):
        measure_apart(Variant("default"), cases[:1], folder, args, folder / "kernels")
        futures = [pool.submit(run, variant) for variant in waiting]
        try:
            for future in as_completed(futures):
                results.add(*future.result())
                bar.set_description(future.result()[0].label, refresh=False)
                bar.update()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def measure_apart(variant: Variant, cases: list[str], folder: Path, args, kernels: Path | None = None) -> dict:
    """Rows by case, from a process of its own, which leaves its kernels in `kernels` if that is given."""
    with TemporaryDirectory(dir=folder) as own:
        cache, rows = kernels or Path(own) / "kernels", Path(own) / "rows"
        if not kernels and not args.compile_all:
            shutil.copytree(folder / "kernels", cache, ignore=shutil.ignore_patterns(*files_of_kernels(variant)))
        task = {"data": str(args.data), "folder": str(folder), "rows": str(rows), "cases": cases,
                "repeats": args.repeats, "where": variant.where, "name": variant.name, "value": variant.value,
                "options": variant.options}
        environment = {"NUMBA_CACHE_DIR": str(cache), "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run([sys.executable, __file__, MEASURE, repr(task)], env=os.environ | environment,
                                  capture_output=True, text=True, timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            failed = f"not done after {TIMEOUT_S} s"
        else:
            if done.returncode == 0:
                return json.loads(rows.read_text())
            lines = done.stderr.strip().splitlines()
            failed = f"ended by signal {-done.returncode}" if done.returncode < 0 else (lines or ["no message"])[-1]
    if variant.label == "default":
        sys.exit(f"the default fails: {failed}")
    return {case: {"failed": failed.replace("|", "/")[:120]} for case in cases}


def files_of_kernels(variant: Variant) -> list[str]:
    """numba's files of the kernels that may contain the constant: their module, or one that it imports, names it."""
    sources = {}
    for file in source_files():
        module = ".".join(file.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        sources[module] = file.read_text()
    imports = {module: set(re.findall(r"^\s*(?:from|import) (srt3d_ros[\w.]*)", text, re.MULTILINE))
               for module, text in sources.items()}
    found = {module for module, text in sources.items()
             if variant.name and module != variant.where and re.search(rf"\b{variant.name}\b", text)}
    while more := {module for module in sources if imports[module] & found} - found:
        found |= more
    return [f"{module.rsplit('.', 1)[-1]}.*.nb?" for module in found]


def measure(task: str) -> None:
    """What the process of a variant does: set the constant before any module reads it, then reconstruct."""
    task = ast.literal_eval(task)
    if task["name"]:
        setattr(import_module(task["where"]), task["name"], task["value"])
    from ablation_cases import load_sketches, open_trial, reconstruct
    rows = {case: reconstruct(open_trial(case, Path(task["data"])), load_sketches(case, Path(task["folder"])),
                              task["options"], task["repeats"]) for case in task["cases"]}
    Path(task["rows"]).write_text(json.dumps(rows))


def table(variants: list[Variant], cases: list[str], results: Results) -> str:
    """Markdown: the means of the default, and what each variant changes."""
    default, *others = variants
    before = numbers(default, cases, results)
    means = [f"{value:.2f}{unit}" if np.isfinite(value := mean(before[metric])) else "–"
             for metric, unit in UNITS.items()]
    lines = [f"Cases: {', '.join(cases)}. Mean changes against the default; CPU time of all cases. Worst: the greatest "
             "sum of points of TD lost, points of FD gained and % of DAE gained, or % of nats lost.\n",
             "| variant | TD, points | FD, points | DAE, % | IAE, % | within 1 std, points | nats / 100 pixels | "
             "time, % | worst case: TD / FD / DAE |", "|---" * 9 + "|",
             f"| default | {' | '.join(means)} | {before['cpu_ms'].sum():.0f} ms | |"]
    for variant in others:
        rows = {case: row for case in cases if (row := results.get(variant, case))}
        failed = next((row["failed"] for row in rows.values() if row.get("failed")), "")
        if failed or not rows:
            cells = [f"fails: {failed}" if failed else "none of these cases", *[""] * 7]
        else:
            cells = changes(variant, default, list(rows), results)
        lines.append(f"| {variant.label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def changes(variant: Variant, default: Variant, cases: list[str], results: Results) -> list[str]:
    """The cells of a variant's row."""
    before, after = numbers(default, cases, results), numbers(variant, cases, results)
    td, fd, nats = (after[metric] - before[metric] for metric in ("td_percent", "fd_percent", "held_out_nats"))
    dae, iae = (100 * (after[metric] - before[metric]) / np.maximum(before[metric], 1e-9)
                for metric in ("dae_bins", "iae"))
    within = after["within_1_std_percent"] - before["within_1_std_percent"]
    nats_percent = 100 * nats / np.abs(before["held_out_nats"])
    losses = [np.maximum(np.nan_to_num(loss), 0) for loss in (-td, fd, dae, -nats_percent)]
    worst = int(sum(losses).argmax())
    text = f"{cases[worst]}: " + (f"{signed(nats[worst])} nats" if np.isfinite(nats[worst]) else
                                  f"{signed(td[worst])} / {signed(fd[worst])} / {signed(dae[worst], 1)} %")
    if sum(losses)[worst] == 0:
        same = all(np.array_equal(before[metric], after[metric], equal_nan=True) for metric in QUALITY)
        text = "nothing changes" if same else "none is worse in these"
    time = 100 * (after["cpu_ms"].sum() / before["cpu_ms"].sum() - 1)
    return [*(signed(mean(change)) for change in (td, fd, dae, iae, within, nats)), signed(time, 0), text]


def numbers(variant: Variant, cases: list[str], results: Results) -> dict[str, np.ndarray]:
    """Each metric of all cases, NaN where a case has none."""
    rows = [results.get(variant, case) for case in cases]
    return {metric: np.array([float("nan" if row.get(metric, "") == "" else row[metric]) for row in rows])
            for metric in METRICS}


def mean(values: np.ndarray) -> float:
    """Of those that are not NaN."""
    return float(np.nanmean(values)) if not np.isnan(values).all() else float("nan")


def signed(value: float, digits: int = 2) -> str:
    return f"{value:+.{digits}f}".replace("-", "−") if np.isfinite(value) else "–"


if __name__ == "__main__":
    measure(sys.argv[2]) if sys.argv[1:2] == [MEASURE] else main()
