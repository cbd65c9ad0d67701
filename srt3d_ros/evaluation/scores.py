"""Write results.csv, one row a reconstruction, and the table that summarises it."""

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

RESULT_COLUMNS = (
    "source", "sbr", "ppp", "method", "sketch_size", "surfaces", "rows", "cols", "tolerance_bins", "held_out",
    "frequencies", "num_bins", "bin_width_mm", "photons_per_pixel", "points", "true_detections_percent",
    "true_detections_by_surface_percent", "false_detections_percent", "dae_bins", "dae_mm", "iae",
    "within_1_std_percent", "within_2_std_percent", "held_out_nats", "held_out_std", "sketch_ms", "reconstruct_ms",
    "version")
HEADINGS = ("source", "SBR", "photons / pixel", "method", "m", "TD %", "FD %", "DAE bins", "DAE mm", "IAE",
            "≤ 1 σ %", "≤ 2 σ %", "points", "held-out nats / 100 pixels")
NOTHING = "–"
_DECIMALS = {"false_detections_percent": 1, "dae_bins": 2, "dae_mm": 2, "iae": 3, "within_1_std_percent": 0,
             "within_2_std_percent": 0}


@contextmanager
def table_of_rows(path: Path) -> Iterator[Callable[[dict], None]]:
    """Give a function that appends a row to results.csv and flushes it to the disk."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, RESULT_COLUMNS, lineterminator="\n")
        writer.writeheader()

        def write(row: dict) -> None:
            writer.writerow({name: _as_text(row.get(name)) for name in RESULT_COLUMNS})
            file.flush()

        yield write


def is_table(path: Path) -> bool:
    """Whether a file begins like a results.csv of any version."""
    with open(path, "rb") as file:
        return file.readline().startswith(",".join(RESULT_COLUMNS[:3]).encode())


def _as_text(value) -> str:
    """A value in the file: floats with 6 digits, None and NaN empty, lists with semicolons."""
    if value is None or value != value:
        return ""
    if isinstance(value, (tuple, list)):
        return ";".join(map(_as_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def markdown(rows: list[dict]) -> str:
    """A table of rows without empty columns."""
    lines = [HEADINGS, *map(_cells, rows)]
    filled = [column for column in zip(*lines) if set(column[1:]) != {NOTHING}]
    lines = list(zip(*filled))
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    text = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths)) + " |" for line in lines]
    return "\n".join([text[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *text[1:]])


def _cells(row: dict) -> list[str]:
    surfaces, ppp = row.get("true_detections_by_surface_percent", ()), row["photons_per_pixel"]
    detected = " + ".join(f"{share:.1f}" for share in surfaces)
    held_out = f"{row['held_out_nats']:.1f} ± {row['held_out_std']:.1f}" if row.get("held_out") else NOTHING
    return [row["source"], f"{row['sbr']:g}" if row["sbr"] else NOTHING,
            f"{ppp:.3g}" if ppp < 999.5 else f"{ppp:.0f}", row["method"], str(row["sketch_size"] or NOTHING),
            detected or NOTHING, *(_shown(row.get(name), digits) for name, digits in _DECIMALS.items()),
            f"{row['points']:.0f}", held_out]


def _shown(value: float | None, digits: int) -> str:
    return f"{value:.{digits}f}" if value is not None and np.isfinite(value) else NOTHING
