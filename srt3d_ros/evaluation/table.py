"""The results as a markdown table, averaged over repeats."""

from collections.abc import Iterable, Sequence

import numpy as np

from srt3d_ros.evaluation.results import KEY, number
from srt3d_ros.evaluation.run import Job

_MEANS = ("photons_per_pixel", "points", "true_detections_percent", "false_detections_percent", "dae_bins", "dae_mm",
          "iae", "background_nmse", "within_1_std_percent", "within_2_std_percent", "sketch_ms", "reconstruct_ms")
_LISTS = ("true_detections_by_surface_percent", "within_nominal_percent")
HEADINGS = ("source", "SBR", "photons / pixel", "method", "m", "TD %", "FD %", "DAE bins", "DAE mm", "IAE",
            "≤ 1 σ %", "≤ 2 σ %", "points")


def averaged(rows: Iterable[dict[str, str]]) -> list[dict]:
    """One row for all repeats, in the order of the first, with the means of the figures as floats, NaN without data."""
    groups: dict[tuple, list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in KEY if name != "repeat"), []).append(row)
    return [_mean(group) for group in groups.values()]


def markdown(rows: list[dict]) -> str:
    """A table of averaged rows."""
    return aligned([HEADINGS, *(_cells(row) for row in rows)])


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """A markdown table of cells with aligned columns; the first line is the heading."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    text = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths)) + " |" for line in lines]
    return "\n".join([text[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *text[1:]])


def rows_of(jobs: Iterable[Job], results) -> list[dict[str, str]]:
    """The rows of the jobs that have results."""
    return [results[job.key] for job in jobs if job.key in results]


def _mean(group: list[dict[str, str]]) -> dict:
    means = {name: _nanmean([number(row, name) for row in group]) for name in _MEANS}
    lists = {name: tuple(_nanmean(column) for column in zip(*(_numbers(row[name]) for row in group)))
             for name in _LISTS}
    return {**group[0], **means, **lists}


def _numbers(text: str) -> list[float]:
    return [float(part or "nan") for part in text.split(";")] if text else []


def _nanmean(values) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _cells(row: dict) -> list[str]:
    surfaces = row["true_detections_by_surface_percent"]
    detected = " + ".join(f"{share:.1f}" for share in surfaces) or _shown(row["true_detections_percent"], 1)
    decimals = {"false_detections_percent": 1, "dae_bins": 2, "dae_mm": 2, "iae": 3, "within_1_std_percent": 0,
                "within_2_std_percent": 0}
    ppp = row["photons_per_pixel"]
    return [row["source"], row["sbr"] or "–", f"{ppp:.3g}" if ppp < 999.5 else f"{ppp:.0f}", row["method"],
            row["sketch_size"] or "–", detected, *(_shown(row[name], digits) for name, digits in decimals.items()),
            f"{row['points']:.0f}"]


def _shown(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "–"
