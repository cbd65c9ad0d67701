"""The README.md and the figures of an evaluation."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from srt3d_ros import __version__
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS
from srt3d_ros.core.metrics import depth_errors
from srt3d_ros.datasets.files import read_npz_arrays
from srt3d_ros.evaluation.results import Results, averaged, markdown, number
from srt3d_ros.evaluation.run import NOMINAL, Job, aligned_reference
from srt3d_ros.pictures.curves import draw_calibration, draw_metrics
from srt3d_ros.pictures.panels import Panel, Strip, draw_clouds, draw_errors
from srt3d_ros.versions import MEASURED_WITH, machine

STRIPS = 10         # most rows of a picture that is still readable
GOALS = {0.6827: (0.60, 0.76), 0.9545: (0.90, 0.98)}        # observed shares within 1 and 2 standard deviations


def write(folder: Path, jobs: Sequence[Job], results: Results, notes: Sequence[str], command: str) -> list[dict]:
    """Draw the figures and write README.md; returns the averaged rows.

    `notes` are lines for the user, `command` is the command line of this evaluation.
    """
    rows = averaged(results[job.key] for job in jobs if job.key in results)
    figures = [*_curves(folder, rows), *_calibration(folder, rows), *_pictures(folder, jobs, results)]
    facts = machine()
    lines = ["# Evaluation", "", f"    {command}", "",
             f"srt3d_ros {__version__}, {facts['date']}, {facts['cpus']} CPUs of {facts['machine']}; Python "
             f"{facts['python']}, {', '.join(f'{name} {facts[name]}' for name in MEASURED_WITH if facts[name])}.", ""]
    lines += [f"- {note}" for note in notes] + [""] * bool(notes)
    lines += [markdown(rows), "", "True detections of several surfaces: of each, a + between. `results.csv` has "
              "more columns.", ""]
    lines += [f"![{path.stem}]({path.name})\n" for path in figures]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")
    return rows


def _curves(folder: Path, rows: Sequence[dict]) -> list[Path]:
    """Draw the metrics of each scene against photons per pixel; returns the files."""
    drawn = []
    for source in dict.fromkeys(row["source"] for row in rows if row["sbr"]):
        chosen = [row for row in rows if row["source"] == source]
        first, bin_mm = chosen[0], number(chosen[0], "bin_width_mm")
        drawn.append(folder / f"metrics_{source}.png")
        draw_metrics(drawn[-1], chosen, f"{source}: {first['rows']} × {first['cols']} pixels, {first['num_bins']} bins "
                     f"of {bin_mm:.3g} mm, tolerance {number(first, 'tolerance_bins') * bin_mm:.3g} mm", list(METHODS))
    return drawn


def _calibration(folder: Path, rows: Sequence[dict]) -> list[Path]:
    """Draw observed against nominal shares of the default method, of each scene and of all files together."""
    chosen = [row for row in rows if row["method"] == DEFAULT_METHOD and row["within_nominal_percent"]]
    size = min((row["sketch_size"] for row in chosen), key=lambda m: abs(int(m) - 10), default=None)
    pictures: dict[str, dict[str, dict]] = {}
    for row in chosen:
        if row["sketch_size"] == size:
            source, heading, label = "files", "photon files", row["source"]
            if row["sbr"]:
                source, heading, label = row["source"], f"SBR {row['sbr']}", f"{row['ppp']} ppp"
            pictures.setdefault(source, {}).setdefault(heading, {})[label] = row["within_nominal_percent"]
    for source, lines in pictures.items():
        draw_calibration(folder / f"calibration_{source}.png", lines, NOMINAL, GOALS,
                         f"{source}: calibration ({DEFAULT_METHOD}, m = {size})")
    return [folder / f"calibration_{source}.png" for source in pictures]


def _pictures(folder: Path, jobs: Sequence[Job], results: Results) -> list[Path]:
    """Draw clouds side by side, and their errors, of each scene and of all files together."""
    drawn = []
    shown = [job for job in jobs if job.cloud_path is not None and job.cloud_path.exists() and job.key in results]
    for source in dict.fromkeys(_picture_of(job) for job in shown):
        chosen = [job for job in shown if _picture_of(job) == source]
        cases = list(dict.fromkeys(job.case for job in chosen))
        cases.sort(key=lambda case: -(case.sbr or 0))
        strips = [_strip([job for job in chosen if job.case is case], results) for case in cases[:STRIPS]]
        drawn.append(folder / f"reconstructions_{source}.png")
        draw_clouds(drawn[-1], strips, f"{source}: reconstructions, coloured by range")
        if any(strip.known is not None for strip in strips):
            drawn.append(folder / f"errors_{source}.png")
            draw_errors(drawn[-1], strips, f"{source}: depth errors (black: no point, grey: no reference)")
    return drawn


def _picture_of(job: Job) -> str:
    return "files" if job.case.sbr is None else job.case.source


def _strip(jobs: Sequence[Job], results: Results) -> Strip:
    """The truth and the clouds of one case."""
    case = jobs[0].case
    observation = case.observe()
    truth = observation.true_cloud(case.grid)
    panels = [] if truth is None else [Panel("truth" if case.sbr else "reference", truth, f"{len(truth):,} points")]
    for job in jobs:
        cloud, row = load_cloud(job.cloud_path), results[job.key]
        error_mm = None
        if truth is not None:
            reference, _, _ = aligned_reference(cloud, case, observation)
            error_mm = _error_map(cloud, reference, case.sensor)
        size = "" if job.sketch_size is None else f", m = {job.sketch_size}"
        panels.append(Panel(f"{job.method.name}{size}", cloud, _caption(row), error_mm))
    ppp = f"{case.ppp or observation.frame.photons / case.sensor.pixels:.3g}"
    what = case.source if case.sbr is None else f"SBR {case.sbr:g}"
    label = f"{what}, {ppp} {'photon' if ppp == '1' else 'photons'} per pixel"
    known = None if truth is None else np.isfinite(observation.depth_bins).any(axis=0)
    return Strip(label, case.grid, panels, known)


def load_cloud(path: Path) -> PointCloud:
    """A cloud that cloud_files.save wrote as .npz."""
    names = tuple(PointCloud.__dataclass_fields__)
    arrays = read_npz_arrays(path, names)
    return PointCloud(**{name: arrays[name] for name in names if name != "stamp_ns"}, stamp_ns=int(arrays["stamp_ns"]))


def _error_map(cloud, reference: np.ndarray, sensor) -> np.ndarray:
    """Depth error of the strongest point of each pixel, mm, NaN = no point; float [rows, cols]."""
    error_mm = np.full(cloud.background.shape, np.nan)
    strongest = cloud.surface == 0
    errors = depth_errors(cloud, reference, sensor.num_bins)[strongest] * sensor.bin_width_m * 1e3
    error_mm[cloud.row[strongest], cloud.col[strongest]] = errors
    return error_mm


def _caption(row: dict[str, str]) -> str:
    if not row["true_detections_percent"]:
        nats = f"  {number(row, 'held_out_nats'):.1f} nats / 100 pixels" if row["held_out"] else ""
        return f"{int(row['points']):,} points{nats}"
    return (f"TD {number(row, 'true_detections_percent'):.1f} %  FD {number(row, 'false_detections_percent'):.1f} %  "
            f"DAE {number(row, 'dae_mm'):.3g} mm")
