"""results.csv: a row for each reconstruction, written at once, so that an interrupted evaluation can be resumed."""

import csv
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

# Of the file. In format 1, "srt3d" was the method that is called "pooled" now.
FORMAT = "2"
# The columns that identify a row.
KEY = ("source", "sbr", "ppp", "repeat", "method", "sketch_size", "surfaces", "rows", "cols", "tolerance_bins",
       "aligned")
FIGURES = ("frequencies", "num_bins", "bin_width_mm", "photons_per_pixel", "points", "true_detections_percent",
           "true_detections_by_surface_percent", "false_detections_percent", "dae_bins", "dae_mm", "iae",
           "background_nmse", "within_1_std_percent", "within_2_std_percent", "within_nominal_percent",
           "offset_bins", "sketch_ms", "reconstruct_ms", "format", "version")
COLUMNS = KEY + FIGURES
EXPECTED = "one by this version: another --out, or --fresh to start anew"


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
        self._rows: dict[tuple[str, ...], dict[str, str]] = {}
        if fresh or not path.exists() or path.stat().st_size == 0:
            self._rewrite()
            return
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            try:
                require(tuple(reader.fieldnames or ()) == COLUMNS, str(path), "a table with other columns", EXPECTED)
                rows = [row for row in reader if None not in row.values() and None not in row]    # whole lines only
                require(all(row["format"] == FORMAT for row in rows), str(path), "of another format", EXPECTED)
            except (csv.Error, UnicodeDecodeError) as error:
                raise InvalidInput(str(path), f"unreadable ({error})", "a results.csv of srt3d evaluate") from None
        self._rows = {key_of(row): row for row in rows}
        self._rewrite()

    def __contains__(self, row: dict) -> bool:
        return key_of(row) in self._rows

    def __getitem__(self, row: dict) -> dict[str, str]:
        """The row with the same key."""
        return self._rows[key_of(row)]

    def append(self, row: dict) -> None:
        """Add a row; it is on the disk when this returns."""
        text = {name: format_value(row.get(name)) for name in COLUMNS} | {"format": FORMAT}
        self._rows[key_of(text)] = text
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(text)

    def _rewrite(self) -> None:
        """Write the whole file: an interrupted run may have left half a line."""
        with open(self.path, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._rows.values())


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
