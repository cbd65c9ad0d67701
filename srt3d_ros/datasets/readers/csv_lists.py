"""Read lists of photons from .csv files: a line a photon, whose header names the columns of row, column and ToA."""

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.axes import DIMENSIONS
from srt3d_ros.datasets.irf_files import UNIT, UNITS_S
from srt3d_ros.datasets.named_arrays import COLUMNS, PHOTONS, Content
from srt3d_ros.datasets.options import AXES, Options
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, read_errors

MAX_TEXT_BYTES = MAX_ARRAY_BYTES // 4       # six characters a photon become three numbers of eight bytes
MAX_HEADER = 2**16                          # characters
NEAR = 1e-3         # of a bin: times of a clock, as rounded in the file


def read(path: Path, options: Options) -> Content:
    """Photons of a .csv file, separated by commas, semicolons or tabs.

    ToA with a unit in the header become bins of bin_width_s.
    """
    expected = "a line of names, and a line of numbers for each photon"
    with read_errors(path, expected), warnings.catch_warnings():
        size = path.stat().st_size
        require(size <= MAX_TEXT_BYTES, "size", f"{size} bytes", f"at most {MAX_TEXT_BYTES}: save .npy or .npz")
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            header = file.readline(MAX_HEADER)
            separator = next((one for one in ";\t," if one in header), ",")
            names = [name.strip().strip('"') for name in header.strip().lstrip("#").split(separator)]
            columns = options.columns or _columns(names)
            for name in columns:
                require(name in names, name, problem=f"The file has no column {name}. Its first line must name "
                        f"{PHOTONS}. It has {', '.join(names)}. (An IRF is given by --irf.)")
            warnings.simplefilter("ignore")         # of a file without photons
            lines = (line.replace(",", ".") for line in file) if separator != "," else file
            table = np.loadtxt(lines, delimiter=separator, quotechar='"', ndmin=2,
                               usecols=[names.index(name) for name in columns])
        require(table.size > 0, "", problem="The file has no photons.")
        if unit := UNIT.search(columns[-1].lower()):
            width_s = finite("bin_width_s", options.known.get("bin_width_s", 0), "seconds")
            require(width_s > 0, "bin_width_s", problem=f"{columns[-1]} is in {unit[1]}: give bin_width_s "
                    "(--bin-width-s).")
            toa = table[:, -1] * (UNITS_S[unit[1]] / width_s)
            table[:, -1] = np.rint(toa) if np.abs(toa - np.rint(toa)).max() < NEAR else toa
    return Content(dict(zip(columns, table.T)), replace(options, columns=columns), (), ", ".join(names), PHOTONS)


def _columns(names: list[str]) -> tuple[str, ...]:
    """The columns of row, column and ToA, or of pixel and ToA, by the first words of their names, as in `t_ns`."""
    words = {re.split(r"[\W_]", name.lower())[0]: name for name in names}
    row, col, toa = (next((words[word] for word in words if word in DIMENSIONS[axis]), usual)
                     for axis, usual in zip(AXES, COLUMNS))
    return (words["pixel"], toa) if "pixel" in words else (row, col, toa)
