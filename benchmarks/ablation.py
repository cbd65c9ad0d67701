"""What the constants of `pooled` are worth: quality and time with each halved, doubled and, where it can be, off.

    python -m benchmarks ablation                               # everything: hours on two cores
    python -m benchmarks ablation --constants PRIOR_VOTE,SPREAD --only "bust*,room_64_2_50"

Cases are photon files, those without a reference judged by held-out photons, and simulated scenes named like
`bust_1_10`: SBR 1, 10 photons per pixel. The first line has the means of the default, those of the variants the mean
changes over the cases (of `dae_bins` and `reconstruct_ms` in %), and the case that loses most.
"""

import argparse
import ast
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from srt3d_ros.kernels import constants

REPOSITORY = Path(__file__).resolve().parents[1]
METRICS = ("true_detections_percent", "false_detections_percent", "dae_bins", "within_1_std_percent", "held_out_nats",
           "reconstruct_ms")
LOSSES = {"true_detections_percent": -1, "false_detections_percent": 1, "dae_bins": 1, "held_out_nats": -1}    # signs
RELATIVE = ("dae_bins", "reconstruct_ms")       # a change is in %
SIMULATED = {f"{scene}_{sbr:g}_{ppp:g}": (scene, sbr, ppp) for scene, sbr, ppp in (
    ("bust", 10, 1), ("bust", 1, 1), ("bust", 1, 10), ("bust", 0.1, 10), ("bust", 1, 100), ("net", 1, 10))}
TOLERANCES = {"room_64_2_50": "3", "room_64_10_50": "3", "bowling_72x88_2_100": "3", "reindeer_72x88_2_100": "3",
              "mannequin_face_340": "40", "two_layer_100": "40"}        # bins; of other files 10
ALIGNED = {"two_layer_100": (1,)}       # references, from 0, to be shifted by their median offset from the cloud
SKETCH_SIZE = 10
HELD_OUT = 0.4                          # share of the photons, of a file without a reference, that judges the cloud
FIXED = ("MAX_SKETCH_SIZE", "MAX_PHOTONS",      # limits
         "FINE", "CELL", "RIDGE",               # the grid of the pool, which fits together, and rounding
         "SLANTED",                             # one of the scales
         "INTENSITY_RATE", "APSS_*",            # of the baselines
         "STAY")                                # of warm_start
NONE, ANY = 0, 1e6
OFF = {"FAINTEST": NONE, "APART": -1, "WEAK": NONE, "LEAST_SHARE": NONE, "DEAD_PIXEL": -ANY, "LIKENESS": ANY,
       "VOTE_SIGMA": ANY, "PRIOR_VOTE": NONE, "MAX_VOTE": ANY, "EMPTY_PENALTY": NONE, "FEWER_PENALTY": NONE,
       "BIRTH": NONE, "JUDGED": 1, "RESOLVED": NONE, "SPREAD": NONE}
MOST = {"WINDOWS[:, 1]": 16}                    # beyond this margin kernels read other memory
Rows = dict[str, dict]                          # the metrics of each case


@dataclass(frozen=True)
class Variant:
    """The default, or one constant with another value."""

    label: str
    name: str = ""
    value: object = None


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared/data/photons", metavar="DIR",
                        help="folder of photon files, *.npz (%(default)s)")
    parser.add_argument("--constants", default="*", metavar="A,B", help="only these; * and ? as in file names")
    parser.add_argument("--only", default="*", metavar="CASE,…",
                        help="only these cases, such as two_layer_100, bust_1_10 or 'bust*'")
    parser.add_argument("--jobs", type=int, default=2, metavar="N",
                        help="processes at a time, of one thread each (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    cases = matching([*sorted(file.stem for file in args.data.glob("*.npz")), *SIMULATED], args.only, "--only")
    numbers = {name: value for name, value in vars(constants).items()
               if name.isupper() and not any(fnmatch(name, pattern) for pattern in FIXED)}
    chosen = matching(list(numbers), args.constants, "--constants")
    variants = [Variant("default"), *(variant for name in chosen for variant in variants_of(name, numbers[name]))]
    with ThreadPoolExecutor(args.jobs) as pool:
        measured = pool.map(lambda variant: measure_apart(variant, cases, args.data), variants)
        default = next(measured)
        yield {"variant": "default", **means(default)}
        for variant, rows in zip(tqdm(variants[1:], unit="variant"), measured):
            changes = {case: {metric: change(default[case], row, metric) for metric in row}
                       for case, row in rows.items()}
            losses = {case: sum(max(sign * one.get(metric, 0), 0) for metric, sign in LOSSES.items())
                      for case, one in changes.items()}
            yield {"variant": variant.label, **means(changes), "worst": max(losses, key=losses.get, default="fails")}


def matching(names: list[str], patterns: str, option: str) -> list[str]:
    """The names that one of the patterns fits."""
    found = [name for name in names if any(fnmatch(name, pattern) for pattern in patterns.split(","))]
    return found or sys.exit(f"{option} {patterns}: expected some of {', '.join(names)}")


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


def measure_apart(variant: Variant, cases: list[str], data: Path) -> Rows:
    """The rows from a process of its own, which compiles all kernels with the variant's constant; none if it fails."""
    with TemporaryDirectory() as cache:
        environment = {"NUMBA_CACHE_DIR": cache, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        task = repr((variant.name, variant.value, cases, str(data)))
        done = subprocess.run([sys.executable, "-m", "benchmarks.ablation", task], cwd=REPOSITORY,
                              env=os.environ | environment, stdout=subprocess.PIPE, text=True)
    if done.returncode and variant.label == "default":
        raise RuntimeError("the default fails")
    return {} if done.returncode else json.loads(done.stdout.splitlines()[-1])


def measure(name: str, value, cases: list[str], data: str) -> Rows:
    """What the process of a variant does: set the constant before any module reads it, then judge each case."""
    if name:
        setattr(constants, name, value)
    from srt3d_ros.core.methods import METHODS
    from srt3d_ros.evaluation import held_out
    from srt3d_ros.evaluation.cases import of_files, simulated
    from srt3d_ros.evaluation.run import Job, judge, reconstruct

    rows = {}
    for case_name in cases:
        if case_name in SIMULATED:
            scene, sbr, ppp = SIMULATED[case_name]
            (case,) = simulated(scene, [sbr], [ppp])
        else:
            file, tolerance = [f"{data}/{case_name}.npz"], TOLERANCES.get(case_name)
            (case,) = of_files(file, tolerance, aligned=ALIGNED.get(case_name, ()))
            if case.observe().depth_bins is None:
                (case,) = of_files(file, tolerance, held_out_share=HELD_OUT)
        observation = case.observe()
        cloud, facts = reconstruct(Job(case, METHODS["pooled"], SKETCH_SIZE), observation)
        if observation.held_out is None:
            judged = judge(cloud, case, observation)
        else:
            judged = held_out.gain(cloud, case.sensor, observation.frame, observation.held_out, HELD_OUT)
        judged = judged | {"reconstruct_ms": facts["reconstruct_ms"]}
        rows[case_name] = {metric: judged[metric] for metric in METRICS if metric in judged}
    return rows


def means(rows: Rows) -> dict[str, float]:
    """Of each metric over the cases that have it."""
    values = {metric: [row[metric] for row in rows.values() if metric in row] for metric in METRICS}
    return {metric: round(float(np.nanmean(several)), 3) for metric, several in values.items() if several}


def change(before: dict, after: dict, metric: str) -> float:
    """In %, or in the points that the metric has."""
    return 100 * (after[metric] / before[metric] - 1) if metric in RELATIVE else after[metric] - before[metric]


if __name__ == "__main__":
    print(json.dumps(measure(*ast.literal_eval(sys.argv[1]))))
