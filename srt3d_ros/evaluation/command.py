"""`srt3d evaluate`: from options to results, table and figures."""

import argparse
import shlex
import sys
from pathlib import Path

from tqdm import tqdm

from srt3d_ros.core.methods import METHODS, Method, find
from srt3d_ros.core.pooled import MAX_SURFACES, check_options
from srt3d_ros.errors import require
from srt3d_ros.evaluation import cases, report
from srt3d_ros.evaluation.results import Results, markdown
from srt3d_ros.evaluation.run import METHOD_OPTIONS, jobs_for, run, with_clouds

SBR, PPP, SKETCH_SIZES = (10.0, 1.0, 0.1), (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0), (5, 10, 20)
QUICK_PPP, FILE_SKETCH_SIZES = (1.0, 10.0, 100.0), (10,)
USUAL_SKETCH_SIZE = 10
QUICK_SIDE = 71         # pixels along the side of the quick look's head


def evaluate(args: argparse.Namespace) -> int:
    """Run `srt3d evaluate`; returns the exit code."""
    chosen, notes = _cases(args)
    methods = [find(name) for name in dict.fromkeys(args.methods or METHODS)]
    sizes = sorted(set(args.sketch_size or (FILE_SKETCH_SIZES if args.files or args.quick else SKETCH_SIZES)))
    require(min(sizes) >= 1, "--sketch-size", min(sizes), "integers of 1 or more")
    options = _options(args, methods)
    folder = _folder(args.out)
    shown = _shown_cases(chosen)
    size = min(sizes, key=lambda m: abs(m - USUAL_SKETCH_SIZE))
    jobs = with_clouds(jobs_for(chosen, methods, sizes, options),
                       lambda job: job.case in shown and job.sketch_size in (None, size), folder / "clouds")
    results = Results(folder / "results.csv", args.fresh)
    earlier = sum(job.key in results for job in jobs)
    if earlier:
        notes.append(f"{earlier} of {len(jobs)} results are of an earlier run (--fresh measures them again)")
    with tqdm(total=len(jobs), unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 5.0) as bar:
        notes += run(jobs, results, bar)
        bar.set_description("drawing")
        rows = report.write(folder, jobs, results, notes, shlex.join(["srt3d", *sys.argv[1:]]))
        bar.set_description("done")
    for note in notes:
        print(f"srt3d: {note}", file=sys.stderr)
    print(f"{markdown(rows)}\n\n{folder}/  results.csv  README.md  *.png")
    return 0


def _options(args: argparse.Namespace, methods: list[Method]) -> dict[str, object]:
    """The options of methods that were given, which each gets that takes them."""
    found = {name: getattr(args, name) for name in METHOD_OPTIONS if getattr(args, name) is not None}
    for name, value in found.items():
        taking = [method.name for method in METHODS.values() if name in method.options]
        require(any(method.name in taking for method in methods), f"--{name.replace('_', '-')}", value,
                f"one of the methods that take it: {', '.join(taking)}")
    check_options(1, args.false_alarm_rate)
    return found


def _cases(args: argparse.Namespace) -> tuple[list[cases.Case], list[str]]:
    """The cases, and notes on those left out."""
    require(min(args.align, default=1) >= 1, "--align", args.align, "references, numbered from 1")
    require(args.surfaces is None or 1 <= args.surfaces <= MAX_SURFACES, "--surfaces", args.surfaces,
            f"1 to {MAX_SURFACES}")
    require(args.upsampling == 1 or not args.files, "--upsampling", args.upsampling, "1 for photon files")
    share = args.held_out_photons
    require(share is None or 0 <= share < 1, "--held-out-photons", share, "a share of the photons, 0 to below 1")
    require(share is None or args.files and not args.scene, "--held-out-photons", share,
            "photon files only: the truth judges simulated scenes")
    found = cases.of_files(args.files, args.tolerance, args.surfaces, tuple(k - 1 for k in args.align), args.seen,
                           share)
    scenes = args.scene or (() if args.files else cases.PAPER_SCENES)
    sbrs, ppps = args.sbr or SBR, args.ppp or (QUICK_PPP if args.quick else PPP)
    for scene in dict.fromkeys(scenes):
        found += cases.simulated(scene, sbrs, ppps, args.repeats, args.tolerance, args.surfaces,
                                 QUICK_SIDE if args.quick else None, args.upsampling)
    kept = [case for case in found if case.size <= args.max_photons]
    require(bool(kept), "--max-photons", args.max_photons, "enough for one setting")
    left_out = [f"{case.title}: {case.size:.3g} photons are more than --max-photons {args.max_photons:.3g}: left out"
                for case in found if case.size > args.max_photons and case.repeat == 1]
    return kept, [*(note for case in kept for note in case.notes), *left_out]


def _shown_cases(chosen: list[cases.Case]) -> list[cases.Case]:
    """The cases for the pictures: all files; of a scene, for each SBR that with the fewest photons.

    Only cases with at least half a signal photon per pixel count, if there are any.
    """
    shown: dict[tuple, cases.Case] = {}
    for case in sorted(chosen, key=lambda case: case.ppp or 0):
        key = (case.source, case.sbr)
        if case.repeat == 1 and (key not in shown or _signal(shown[key]) < 0.5):
            shown[key] = case
    return list(shown.values())


def _signal(case: cases.Case) -> float:
    """Mean signal photons per pixel; 0 for a file."""
    return 0.0 if case.sbr is None else case.ppp / (1 + 1 / case.sbr)


def _folder(path: Path) -> Path:
    require(not path.exists() or path.is_dir(), "--out", str(path), "a folder")
    of_another = (path / "README.md").exists() and not (path / "results.csv").exists()
    require(not of_another, "--out", str(path), "a folder without a README.md of something else")
    (path / "clouds").mkdir(parents=True, exist_ok=True)
    return path
