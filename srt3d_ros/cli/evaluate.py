"""`srt3d evaluate`: run every method on simulated scenes or photon files and compare the clouds with the truth."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.core.method.thresholds import MAX_SURFACES
from srt3d_ros.core.methods import METHODS, find
from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.errors import require
from srt3d_ros.evaluation.cases import SCENES, Case, of_files, simulated

SCENE_DEFAULTS = {"sbr": [10.0, 1.0, 0.1], "ppp": [1.0, 10.0, 100.0]}
HEAD_DEFAULTS = {"sbr": [1.0], "ppp": [10.0]}         # of `simulator`
FILE_OPTIONS = ("sensor_file", "held_out_photons")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "evaluate",
        description="Reconstruct simulated scenes (or the photon files given) with every method and compare the "
                    "clouds with the truth: a table, DIR/results.csv, and pictures of clouds in DIR. "
                    "docs/evaluation.md explains the figures.")
    parser.add_argument("files", nargs="*", metavar="FILE",
                        help="photon files, or: simulator, its head with SBR 1 and 10 photons per pixel (default: the "
                             "simulated scenes)")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    parser.add_argument("--methods", nargs="+", default=METHODS, metavar="METHOD",
                        help=f"methods to run: {', '.join(METHODS)} (default: all)")
    parser.add_argument("--sketch-size", nargs="+", type=int, default=[DEFAULT_SKETCH_SIZE], metavar="M",
                        help=f"complex numbers per pixel (default: {DEFAULT_SKETCH_SIZE})")
    parser.add_argument("--tolerance", metavar="BINS|MMmm",
                        help="largest depth error of a true detection (default: bust 40mm, net 3, files 10)")
    parser.add_argument("--surfaces", type=int, metavar="K",
                        help="most surfaces per pixel (default: 2 for the net; for a file, its number of references)")
    simulated_scenes = parser.add_argument_group("simulated scenes")
    simulated_scenes.add_argument("--scene", nargs="+", choices=tuple(SCENES), metavar="SCENE",
                                  help=f"scenes to simulate: {', '.join(SCENES)} (default: all)")
    simulated_scenes.add_argument("--sbr", nargs="+", type=float, metavar="R",
                                  help="signal-to-background ratios (default: 10 1 0.1)")
    simulated_scenes.add_argument("--ppp", nargs="+", type=float, metavar="N",
                                  help="mean photons per pixel (default: 1 10 100)")
    photon_files = parser.add_argument_group("photon files")
    common.add_sensor_file(photon_files)
    photon_files.add_argument("--held-out-photons", type=float, metavar="SHARE",
                              help="keep this share of the photons out of the reconstruction and score how well the "
                                   "cloud predicts them (default: 0.4 for a file without a reference, else 0)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from tqdm import tqdm

    from srt3d_ros.evaluation import scores
    from srt3d_ros.evaluation.drawings import draw
    from srt3d_ros.evaluation.run import run_all, runs_of

    cases = _cases(args)
    methods = [find(name) for name in dict.fromkeys(args.methods)]
    sizes = sorted(set(args.sketch_size))
    require(min(sizes) >= 1, "--sketch-size", min(sizes), "integers of 1 or more")
    runs = runs_of(methods, sizes)
    folder = _results_folder(args.out)
    cases_to_draw = _cases_to_draw(cases)
    size_to_draw = min(sizes, key=lambda size: abs(size - DEFAULT_SKETCH_SIZE))
    notes = [note for case in cases for note in case.notes]
    rows, drawn = [], []
    with (tqdm(total=len(cases) * len(runs), unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 5.0) as bar,
          scores.table_of_rows(folder / "results.csv") as write):
        for outcome in run_all(cases, runs, notes, bar):
            rows.append(outcome.row)
            write(outcome.row)
            if outcome.case in cases_to_draw and outcome.run.sketch_size in (None, size_to_draw):
                drawn.append(outcome)
        bar.set_description("drawing")
        draw(folder, drawn)
        bar.set_description("done")
    common.print_notes(notes)
    print(f"{_within(cases)}\n\n{scores.markdown(rows)}\n\n{folder}/  results.csv  *.png")
    return 0


def _cases(args: argparse.Namespace) -> list[Case]:
    """The cases that the options ask for; InvalidInput for an option that cannot be used."""
    files = [name for name in args.files if name != SIMULATOR]
    scenes = {scene: dict(SCENE_DEFAULTS) for scene in args.scene or (() if args.files else SCENES)}
    if len(files) < len(args.files):
        scenes.setdefault("bust", dict(HEAD_DEFAULTS))
    for names, inputs, there in ((SCENE_DEFAULTS, "simulated scenes: add --scene", scenes),
                                 (FILE_OPTIONS, "photon files", files and not (args.held_out_photons and scenes))):
        for name in common.given(args, names):
            option = f"--{name.replace('_', '-')}"
            require(there, option, problem=f"{option} works only with {inputs}.")
    share = args.held_out_photons
    require(args.surfaces is None or 1 <= args.surfaces <= MAX_SURFACES, "--surfaces", args.surfaces,
            f"1 to {MAX_SURFACES}")
    require(share is None or 0 <= share < 1, "--held-out-photons", share, "a share of the photons, 0 to below 1")
    cases = of_files(files, args.tolerance, args.surfaces, share, **common.given_sensor(args))
    for scene, settings in scenes.items():
        settings |= common.given(args, settings)
        cases += simulated(scene, settings["sbr"], settings["ppp"], args.tolerance, args.surfaces)
    return cases


def _within(cases: Sequence[Case]) -> str:
    """The line on how near a point must be, by scene or file."""
    near = {}
    for case in cases:
        tolerance_mm = case.tolerance_bins * case.sensor.bin_width_m * 1e3
        near[case.source] = f"{tolerance_mm:.4g} mm ({case.tolerance_bins:.4g} bins)"
    shared = set(near.values())
    words = shared.pop() if len(shared) == 1 else ", ".join(f"{bins} in {source}" for source, bins in near.items())
    return f"A surface counts as found within {words}."


def _cases_to_draw(cases: Sequence[Case]) -> set[Case]:
    """The cases to draw: every file, and of a scene at each SBR the one with the middle number of photons."""
    alike: dict[tuple, list[Case]] = {}
    for case in sorted(cases, key=lambda case: case.ppp or 0):
        alike.setdefault((case.source, case.sbr), []).append(case)
    return {group[len(group) // 2] for group in alike.values()}


def _results_folder(path: Path) -> Path:
    """Create the folder of the results; InvalidInput if it holds another results.csv than an evaluation's."""
    from srt3d_ros.evaluation.scores import is_table

    require(not path.exists() or path.is_dir(), "--out", problem=f"--out {path} is a file: choose a folder.")
    table = path / "results.csv"
    require(not table.exists() or is_table(table), "--out",
            problem=f"{table} was not written by srt3d evaluate: choose another folder for --out.")
    path.mkdir(parents=True, exist_ok=True)
    return path
