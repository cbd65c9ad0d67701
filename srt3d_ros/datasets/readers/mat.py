"""The .mat files that single-photon lidar data are published in, read unmodified; and others with an array of counts.

SciPy reads them in a child process (mat_variables.py): some damaged files end the process that reads them.
"""

import os
import subprocess
import sys
import tempfile
from math import isqrt
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import number, positive_integer, refuse_channel
from srt3d_ros.datasets.readers import hdf5
from srt3d_ros.datasets.readers.cubes import cube, given_by, parts_of
from srt3d_ros.datasets.readers.mat_variables import CELLS, COUNTS, EXPECTED, LAYOUTS, SPARSE, Layout
from srt3d_ros.datasets.stream import Events, Recording
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.processes import ending

MAX_MEMORY_BYTES = 5 * 2**30     # the most photons in 8 bytes each, in their cells and joined; the rest for the reader
MAX_SECONDS = 600       # fifteen times what files that fill this memory take
EDGE = 1e-6     # of a bin: a time on a bin's edge belongs to the bin that begins there, whatever the rounding


def read(path: Path, options: dict) -> Recording:
    """The photons of a .mat file; of its ToA, bins of the window that the file states, or those that have photons.

    Raises:
        InvalidInput: naming the file, variable or option that cannot be used.
    """
    if hdf5.is_matlab(path):
        return hdf5.read(path, options)
    refuse_channel(options)
    with naming_file(path):
        found = _variables(path)
        index = found.pop("layout").item()
        if index < 0:
            counts = found.pop("counts")
            return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given_by(found))
        return _recording(path, LAYOUTS[index], found, options)


def _variables(path: Path) -> dict[str, np.ndarray]:
    """What mat_variables.py finds in the file, from a child process with the same modules as this one."""
    command = [sys.executable, "-P", "-m", "srt3d_ros.datasets.readers.mat_variables", str(path), str(MAX_MEMORY_BYTES)]
    modules = {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    with tempfile.TemporaryFile() as file:
        try:
            done = subprocess.run(command, env=os.environ | modules, stdin=subprocess.DEVNULL, stdout=file,
                                  stderr=subprocess.DEVNULL, timeout=MAX_SECONDS)
        except subprocess.TimeoutExpired:
            raise InvalidInput(path.name, f"unreadable (not in {MAX_SECONDS} s)", EXPECTED) from None
        require(done.returncode == 0, path.name, f"unreadable (its reader {ending(done)})", EXPECTED)
        file.seek(0)
        with naming_file(path, EXPECTED), np.load(file) as arrays:
            found = dict(arrays)
    if "refused" in found:
        raise InvalidInput(*found["refused"].tolist())
    return found


def _recording(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Recording:
    width_s = number("bin_width_s", options.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    notes = () if "bin_width_s" in options else (f"bin width taken to be {width_s * 1e12:g} ps: the file has none",)
    photons, reference, given = found[layout.variable], found.get(layout.reference), {"bin_width_s": width_s}
    if layout.form == CELLS:
        pixel, toa, (rows, cols) = found["pixel"], photons, found["size"].tolist()
        own = tuple(options.get(name, size) for name, size in (("rows", rows), ("cols", cols)))
        require(own == (rows, cols), "rows, cols", own, f"{rows}, {cols}, as in the file")
        unit = 1e-12 / width_s if layout.picoseconds else 1
        whole = layout.picoseconds or bool((toa == np.floor(toa)).all())
        require(whole, layout.variable, "fractional or not a number in places", "whole bins")
        require(bool(((toa >= 0) & (toa * unit < 2**32)).all()), f"{layout.variable} ToA",
                "below 0 or beyond 2³² bins in places", "times of arrival from 0")
        toa = np.floor(toa * unit + EDGE).astype(np.int64)
        first, bins = _window([found[name].item() * unit for name in layout.window if name in found], toa, options)
        given["gate"] = first, bins
    else:
        pixels, bins = found["size"].tolist()
        _check_bins(options, bins)
        rows, cols = _counted_shape(pixels, reference, options, layout)
    if reference is not None:
        require(reference.shape == (rows, cols), f"{layout.reference} shape", reference.shape, f"{(rows, cols)}")
        reference = reference.astype(np.float32) - np.float32(1)
    if layout.form == COUNTS:
        counts = photons.reshape(bins, cols, rows).transpose(2, 1, 0)
        return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes, reference)
    if layout.form == SPARSE:
        col, row = np.divmod(found["pixel"], rows)
        toa, pixel = photons, row * cols + col
        order = np.lexsort((toa, pixel))
        toa, pixel = toa[order], pixel[order]
    return Recording(rows, cols, bins, width_s, lambda: iter([Events(pixel, toa, 1.0)]), path.stem, notes, given,
                     reference)


def _counted_shape(pixels: int, reference: np.ndarray | None, options: dict, layout: Layout) -> tuple[int, int]:
    """Rows and columns of an array of counts: the options', the reference's, or square."""
    own = (isqrt(pixels),) * 2 if reference is None else reference.shape
    rows, cols = (positive_integer(name, options.get(name, size)) for name, size in zip(("rows", "cols"), own))
    require(rows * cols == pixels, "rows, cols", f"{rows}, {cols}",
            f"rows and cols whose product is the {pixels} pixels of {layout.variable}")
    return rows, cols


def _window(stated: list[float], toa: np.ndarray, options: dict) -> tuple[int, int]:
    """First bin and number of bins to keep: those `stated`, else of `num_bins` or those that have photons."""
    given = int(number("num_bins", options.get("num_bins", 0), "a number of bins"))
    if len(stated) == 2:
        low, high = (number("window", value, "a ToA") for value in stated)
        first, end = int(np.floor(low + EDGE)), int(np.ceil(high - EDGE))
    else:
        _check_bins(options, int(toa.max(initial=-1)) + 1)
        first, end = (0, 0) if given or not toa.size else (int(toa.min()), int(toa.max()) + 1)
    require(first >= 0, "window", f"from bin {first}", "a window from bin 0 or later")
    return first, given or end - first


def _check_bins(options: dict, bins: int) -> None:
    """Refuse a `num_bins` that would drop photons in silence, where no gate says which."""
    given = options.get("num_bins", bins)
    require("gate" in options or number("num_bins", given, "a number of bins") >= bins, "num_bins", given,
            f"{bins} or more, up to the file's last bin; or give a gate")
