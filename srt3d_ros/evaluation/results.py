"""results.csv, a row for each reconstruction, written at once so that an evaluation can be resumed; and its table."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from srt3d_ros.errors import InvalidInput, require

# The columns that identify a row.
KEY = ("source", "sbr", "ppp", "repeat", "method", "sketch_size", "surfaces", "rows", "cols", "tolerance_bins",
       "aligned", "held_out", "false_alarm_rate", "background")
HELD_OUT = tuple(f"held_out_{figure}" for figure in (
    "nats", "std", "rim_nats", "rim_std", "rim_percent", "interior_nats", "interior_std", "interior_percent"))
FIGURES = ("frequencies", "num_bins", "bin_width_mm", "photons_per_pixel", "points", "true_detections_percent",
           "true_detections_by_surface_percent", "false_detections_percent", "dae_bins", "dae_mm", "iae",
           "background_nmse", "within_1_std_percent", "within_2_std_percent", "within_nominal_percent", "swelling_px",
           "offset_bins", *HELD_OUT, "sketch_ms", "reconstruct_ms", "version")
COLUMNS = KEY + FIGURES
EXPECTED = "one by this version: another --out, or --fresh to start anew"
_MEANS = ("photons_per_pixel", "points", "true_detections_percent", "false_detections_percent", "dae_bins", "dae_mm",
          "iae", "background_nmse", "within_1_std_percent", "within_2_std_percent", "swelling_px", *HELD_OUT,
          "sketch_ms", "reconstruct_ms")
_LISTS = ("true_detections_by_surface_percent", "within_nominal_percent")
HEADINGS = ("source", "SBR", "photons / pixel", "method", "m", "TD %", "FD %", "DAE bins", "DAE mm", "IAE",
            "≤ 1 σ %", "≤ 2 σ %", "swelling px", "points")
HELD_OUT_HEADINGS = ("held-out nats / 100 pixels", "of the rim (pixels)", "of the interior (pixels)")
NOTHING = "–"
_DECIMALS = {"false_detections_percent": 1, "dae_bins": 2, "dae_mm": 2, "iae": 3, "within_1_std_percent": 0,
             "within_2_std_percent": 0, "swelling_px": 2}


class Results:
    """The rows of a results.csv, as text by column.

    Args:
        path: the file; created if missing.
        fresh: delete its rows.

    Raises:
        InvalidInput: the file is of something else, or of another format.
    """

    def __init__(self, path: Path, fresh: bool = False):
        self.path = path
        self._rows = {} if fresh or not path.exists() else {key_of(row): row for row in _read(path)}
        with open(path, "w", newline="", encoding="utf-8") as file:     # anew: it may have ended in half a line
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._rows.values())

    def __contains__(self, row: dict) -> bool:
        return key_of(row) in self._rows

    def __getitem__(self, row: dict) -> dict[str, str]:
        """The row with the same key."""
        return self._rows[key_of(row)]

    def append(self, row: dict) -> None:
        """Add a row; it is on the disk when this returns."""
        text = {name: format_value(row.get(name)) for name in COLUMNS}
        self._rows[key_of(text)] = text
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(text)


def _read(path: Path) -> list[dict[str, str]]:
    """The whole rows of a file."""
    if path.stat().st_size == 0:
        return []
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        try:
            require(tuple(reader.fieldnames or ()) == COLUMNS, str(path), "a table with other columns", EXPECTED)
            return [row for row in reader if None not in row.values() and None not in row]
        except (csv.Error, UnicodeDecodeError) as error:
            raise InvalidInput(str(path), f"unreadable ({error})", "a results.csv of srt3d evaluate") from None


def key_of(row: dict) -> tuple[str, ...]:
    """The columns KEY as in the file."""
    return tuple(format_value(row.get(name)) for name in KEY)


def format_value(value) -> str:
    """A value as in the file: floats with 6 digits, missing values and NaN empty, lists with semicolons."""
    if value is None or value != value:
        return ""
    if isinstance(value, (tuple, list)):
        return ";".join(format_value(part) for part in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def number(row: dict[str, str], column: str) -> float:
    """A cell as a number, NaN if it is empty."""
    return float(row[column] or "nan")


def averaged(rows: Iterable[dict[str, str]]) -> list[dict]:
    """One row for all repeats, in the order of the first, with the means of the figures as floats, NaN without data."""
    groups: dict[tuple, list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in KEY if name != "repeat"), []).append(row)
    return [group[0] | {name: _nanmean([number(row, name) for row in group]) for name in _MEANS}
            | {name: _mean_list([row[name] for row in group]) for name in _LISTS} for group in groups.values()]


def _mean_list(texts: list[str]) -> tuple[float, ...]:
    lists = [[float(part or "nan") for part in text.split(";")] if text else [] for text in texts]
    return tuple(_nanmean(column) for column in zip(*lists))


def _nanmean(values) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def markdown(rows: list[dict]) -> str:
    """A table of averaged rows, without columns in which none has anything; of held-out photons if there are any."""
    lines = [[*HEADINGS], *(_cells(row) for row in rows)]
    if any(row["held_out"] for row in rows):
        lines = [line + more for line, more in zip(lines, [[*HELD_OUT_HEADINGS], *map(_held_out_cells, rows)])]
    filled = [column for column in zip(*lines) if set(column[1:]) != {NOTHING}]
    return aligned(list(zip(*filled)))


def _cells(row: dict) -> list[str]:
    surfaces = row["true_detections_by_surface_percent"]
    detected = " + ".join(f"{share:.1f}" for share in surfaces) or _shown(row["true_detections_percent"], 1)
    ppp = row["photons_per_pixel"]
    return [row["source"], row["sbr"] or NOTHING, f"{ppp:.3g}" if ppp < 999.5 else f"{ppp:.0f}", row["method"],
            row["sketch_size"] or NOTHING, detected, *(_shown(row[name], digits) for name, digits in _DECIMALS.items()),
            f"{row['points']:.0f}"]


def _held_out_cells(row: dict) -> list[str]:
    """Nats ± standard error, then what rim and interior add, with their share of the pixels."""
    if not row["held_out"]:
        return [NOTHING] * len(HELD_OUT_HEADINGS)
    cells = [" ± ".join(_shown(row[f"held_out_{part}{figure}"], 1) for figure in ("nats", "std"))
             for part in ("", "rim_", "interior_")]
    shares = ["", *(f" ({row[f'held_out_{part}_percent']:.0f} %)" for part in ("rim", "interior"))]
    return [cell + share for cell, share in zip(cells, shares)]


def _shown(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else NOTHING


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """A markdown table of cells with aligned columns; the first line is the heading."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    text = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths)) + " |" for line in lines]
    return "\n".join([text[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *text[1:]])
