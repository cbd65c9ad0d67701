"""`srt3d evaluate`: from options to results, table and figures."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from srt3d_ros.core.methods import find
from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.core.thresholds import MAX_SURFACES
from srt3d_ros.errors import require
from srt3d_ros.evaluation import scores as results
from srt3d_ros.evaluation.cases import SCENES, Case, of_files, simulated
from srt3d_ros.evaluation.run import jobs_for, run

NO_FIGURES = "no figures without matplotlib: pip install 'srt3d_ros[review]'"


def evaluate(args: argparse.Namespace) -> int:
    """Run `srt3d evaluate`; returns the exit code."""
    cases = _cases(args)
    methods = [find(name) for name in dict.fromkeys(args.methods)]
    sizes = sorted(set(args.sketch_size))
    require(min(sizes) >= 1, "--sketch-size", min(sizes), "integers of 1 or more")
    jobs = jobs_for(cases, methods, sizes)
    folder = _folder(args.out)
    in_pictures, size = _in_pictures(cases), min(sizes, key=lambda m: abs(m - DEFAULT_SKETCH_SIZE))
    notes, rows, shown = [note for case in cases for note in case.notes], [], []
    with (tqdm(total=len(jobs), unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 5.0) as bar,
          results.table_of_rows(folder / "results.csv") as write):
        for outcome in run(jobs, notes, bar):
            rows.append(outcome.row)
            write(outcome.row)
            if outcome.job.case in in_pictures and outcome.job.sketch_size in (None, size):
                shown.append(outcome)
        bar.set_description("drawing")
        means = results.averaged(rows)
        try:
            from srt3d_ros.evaluation.drawings import draw
        except ModuleNotFoundError:
            notes.append(NO_FIGURES)
        else:
            draw(folder, means, shown)
        bar.set_description("done")
    for note in notes:
        print(f"srt3d: {note}", file=sys.stderr)
    print(f"{results.markdown(means)}\n\n{folder}/  results.csv  *.png")
    return 0


def _cases(args: argparse.Namespace) -> list[Case]:
    require(args.repeats >= 1, "--repeats", args.repeats, "1 or more")
    require(min(args.align, default=1) >= 1, "--align", min(args.align, default=1), "references, numbered from 1")
    require(args.surfaces is None or 1 <= args.surfaces <= MAX_SURFACES, "--surfaces", args.surfaces,
            f"1 to {MAX_SURFACES}")
    share = args.held_out_photons
    require(share is None or 0 <= share < 1, "--held-out-photons", share, "a share of the photons, 0 to below 1")
    require(share is None or args.files and not args.scene, "--held-out-photons", share,
            "photon files only: the truth judges simulated scenes")
    found = of_files(args.files, args.tolerance, args.surfaces, [k - 1 for k in args.align], share)
    for scene in dict.fromkeys(args.scene or (() if args.files else SCENES)):
        found += simulated(scene, args.sbr, args.ppp, args.repeats, args.tolerance, args.surfaces)
    return found


def _in_pictures(cases: Sequence[Case]) -> set[Case]:
    """The cases for the pictures: all files; of a scene, for each SBR that with the fewest photons.

    Only cases with at least half a signal photon per pixel count, if there are any.
    """
    found: dict[tuple, Case] = {}
    for case in sorted(cases, key=lambda case: case.ppp or 0):
        key = (case.source, case.sbr)
        if case.repeat == 1 and (key not in found or _signal(found[key]) < 0.5):
            found[key] = case
    return set(found.values())


def _signal(case: Case) -> float:
    """Mean signal photons per pixel; 0 for a file."""
    return 0.0 if case.sbr is None else case.ppp / (1 + 1 / case.sbr)


def _folder(path: Path) -> Path:
    """The folder of the results, whose results of an earlier evaluation are replaced."""
    require(not path.exists() or path.is_dir(), "--out", str(path), "a folder")
    table = path / "results.csv"
    require(not table.exists() or results.is_table(table), "--out", str(path),
            "a folder without results.csv of something else")
    path.mkdir(parents=True, exist_ok=True)
    return path
