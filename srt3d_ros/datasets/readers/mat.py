"""Published .mat files of single-photon lidar, read unmodified; and others with an array of counts."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, MAX_PIXELS
from srt3d_ros.datasets.arrays import MAX_KEPT, are_whole, from_pixels
from srt3d_ros.datasets.options import check_same, outside_note
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers.cubes import GIVEN, cube, in_gate, the_cube
from srt3d_ros.datasets.values import MAX_PHOTONS
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import MAX_BYTES, read_errors
from srt3d_ros.processes.children import ending

EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
EDGE = 1e-6     # of a bin: a time on a bin's edge belongs to the bin that begins there, whatever the rounding


class Layout(NamedTuple):
    """How one published kind of file holds its photons: as [rows, cols] cells of ToA lists, or as [T, rows · cols]
    counts, whose pixels are in MATLAB's column-major order.

    Args:
        variable: name of the array of photons.
        bin_width_s: where the file does not say; what the authors say, or inferred from their description.
        reference: of counts: array [rows, cols] of reference depths, numbered from 1 as MATLAB does.
        picoseconds: ToA are times in picoseconds, not bins.
        window: scalars that hold the first and last ToA of the measured window.
    """

    variable: str
    bin_width_s: float
    reference: str = ""
    picoseconds: bool = False
    window: tuple[str, ...] = ()

    def fits(self, found: dict[str, np.ndarray]) -> bool:
        """Whether the variables of a file are in this form."""
        photons = found.get(self.variable, np.zeros(0))
        counts = photons.dtype.kind in "iuf" and (photons.ndim == 2 or f"{self.variable}.shape" in found)
        return counts if self.reference else f"{self.variable}.lengths" in found


LAYOUTS = (
    Layout("Y", 16e-12, "DepthImage"),              # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                  # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                            # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    Layout("data_processed", 100e-12, picoseconds=True, window=("mm", "MM")),       # USTC, tower at 9.8 km (Li et al.,
                                                    # Optica 2021); the bin width is our choice
    Layout("spad", 80e-12, "bin"),                  # simulated, sparse: Lindell et al., SIGGRAPH 2018
)
WANTED = "; ".join([*(f"{one.variable} ({'[T, rows·cols] counts' if one.reference else '[rows, cols] cell'})"
                      for one in LAYOUTS), "any other numeric array [rows, cols, bins]"])
NAMES = (*(name for one in LAYOUTS for name in (one.variable, one.reference, *one.window) if name), *GIVEN)
CHILD = Path(__file__).with_name("mat_child.py")


def read(path: Path, options: dict) -> Photons:
    """The photons of a .mat file; of its ToA, bins of the window that the file states, or those that have photons.

    Raises:
        InvalidInput: naming the file, variable or option that cannot be used.
    """
    with read_errors(path, EXPECTED):
        found, listed = variables(path)
    with read_errors(path):
        layout = next((one for one in LAYOUTS if one.fits(found)), None)
        if layout is None:
            return the_cube(path, found, options, "variables", f"one of {WANTED}", listed)
        for name in found.keys() & {*layout.window, layout.reference}:
            require(found[name].dtype.kind in "iuf", name, str(found[name].dtype), "numbers")
        return (_of_counts if layout.reference else _of_cells)(path, layout, found, options)


def variables(path: Path) -> tuple[dict[str, np.ndarray], str]:
    """`mat_child.variables` of NAMES, from a child process that may take MAX_BYTES; mapped from a temporary file."""
    modules = os.pathsep.join(map(os.path.abspath, sys.path))
    with tempfile.TemporaryFile() as file:
        # -P: the folder of this file has modules of any name. The caller's modules: the child has the same SciPy.
        done = subprocess.run([sys.executable, "-P", CHILD, path, str(file.fileno()), str(MAX_BYTES), *NAMES],
                              stdin=subprocess.DEVNULL, capture_output=True, pass_fds=(file.fileno(),),
                              env=os.environ | {"PYTHONPATH": modules, "OPENBLAS_NUM_THREADS": "1"})
        why = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        require("MemoryError" not in why, "", f"of variables that take more than {MAX_BYTES} bytes",
                "less: save counts as uint8 or uint16, or as .npy, which may be larger than memory")
        why = f"its reader {ending(done)}" if done.returncode < 0 else why
        require(done.returncode == 0, "", f"unreadable ({why})", EXPECTED)
        content = json.loads(done.stdout)
        arrays = {name: np.memmap(file, kind, "c", place, tuple(shape), order) if 0 not in shape else
                  np.zeros(shape, kind) for name, kind, place, shape, order in content["arrays"]}
    return arrays, content["listed"]


def _of_counts(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Photons:
    """Counts of bins, whose pixels are in column-major order, and reference depths. Sparse ones stay sparse."""
    name, photons = layout.variable, found[layout.variable]
    width_s, notes = _bin_width(layout, options)
    require(are_whole(np.atleast_2d(photons)), name, "negative or fractional in places", "photons per bin")
    bins, pixels = photons.shape if photons.ndim == 2 else found[f"{name}.shape"][::-1].tolist()
    _check_bins(options, bins)
    require(layout.reference in found, layout.reference, "missing", "reference depths [rows, cols]")
    reference = found[layout.reference].astype(np.float32) - np.float32(1)
    require(reference.ndim == 2 and reference.size == pixels <= MAX_PIXELS, f"{layout.reference} shape",
            reference.shape, f"the {pixels} pixels of {name}, {MAX_PIXELS} at most")
    rows, cols = reference.shape
    if photons.ndim == 2:
        counts = photons.reshape(bins, cols, rows).transpose(2, 1, 0)
        return cube(path, counts, options, {"bin_width_s": width_s}, notes, reference)
    total, toa = photons.sum(dtype=np.float64), found[f"{name}.col"]
    require(total <= MAX_KEPT, f"{name} photons", total, f"at most {MAX_KEPT} in a sparse array: save full({name})")
    col, row = np.divmod(found[f"{name}.row"], rows)
    order = np.lexsort((toa, row * cols + col))
    pixel, toa = (values[order].repeat(photons[order].astype(np.int64)) for values in (row * cols + col, toa))
    bins = int(finite("num_bins", options.get("num_bins", bins), "a number of bins"))
    return _of_events(path, layout, pixel, toa, reference.shape, (0, bins), options, reference)


def _of_cells(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Photons:
    """Lists of ToA, a cell for each pixel."""
    name, toa, lengths = layout.variable, found[layout.variable], found[f"{layout.variable}.lengths"]
    require(lengths.ndim == 2 and 0 < lengths.size <= MAX_PIXELS, f"{name} shape", lengths.shape,
            f"[rows, cols], 1 to {MAX_PIXELS} pixels")
    require(toa.dtype.kind in "iuf", f"{name} cells", str(toa.dtype), "lists of numbers")
    require(toa.size <= MAX_PHOTONS, f"{name} photons", toa.size, f"at most {MAX_PHOTONS}")
    whole = layout.picoseconds or bool((toa == np.floor(toa)).all())
    require(whole, name, "fractional or not a number in places", "whole bins")
    unit = 1e-12 / _bin_width(layout, options)[0] if layout.picoseconds else 1
    require(bool(((toa >= 0) & (toa * unit < 2**32)).all()), f"{name} ToA", "below 0 or beyond 2³² bins in places",
            "times of arrival from 0")
    toa = np.floor(toa * unit + EDGE).astype(np.int64)
    window, pixel = _window(layout, found, unit, toa, options), np.arange(lengths.size).repeat(lengths.ravel())
    return _of_events(path, layout, pixel, toa, lengths.shape, window, options)


def _of_events(path: Path, layout: Layout, pixel: np.ndarray, toa: np.ndarray, shape: tuple[int, int],
               window: tuple[int, int], options: dict, reference: np.ndarray | None = None) -> Photons:
    """The photons in the gate, or else in the window: first bin and number of bins."""
    (first, bins), (width_s, notes) = window, _bin_width(layout, options)
    first, last = options.get("gate", (first, first + bins - 1))
    require(last - first < MAX_BINS, "num_bins", last - first + 1, f"at most {MAX_BINS}: give a gate or bin_width_s")
    inside, sides = (toa >= first) & (toa <= last), dict(zip(("rows", "cols"), shape))
    check_same(sides, options)
    own = sides | {"num_bins": last - first + 1, "bin_width_s": width_s,
                   "toa_offset_bins": options.get("toa_offset_bins", 0) + first}
    sensor, events, more = from_pixels(pixel[inside], toa[inside] - first, 0, options | own)
    outside = outside_note(len(toa) - events.photons, len(toa), first, last)
    reference = in_gate(reference, first, sensor.num_bins)
    return Photons(sensor, events, reference, path.stem, notes + more + outside)


def _window(layout: Layout, found: dict[str, np.ndarray], unit: float, toa: np.ndarray, options: dict
            ) -> tuple[int, int]:
    """First bin and number of bins to keep: those the file states, else of `num_bins` or those that have photons."""
    given = int(finite("num_bins", options.get("num_bins", 0), "a number of bins"))
    if all(name in found for name in layout.window or ("",)):
        low, high = (finite(name, found[name].squeeze().tolist(), "one ToA") * unit for name in layout.window)
        first, end = int(np.floor(low + EDGE)), int(np.ceil(high - EDGE))
    else:
        _check_bins(options, int(toa.max(initial=-1)) + 1)
        first, end = (0, 0) if given or not toa.size else (int(toa.min()), int(toa.max()) + 1)
    return first, given or end - first


def _bin_width(layout: Layout, options: dict) -> tuple[float, tuple[str, ...]]:
    """The bin width that is given, or that of the authors with a note."""
    width_s = finite("bin_width_s", options.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    note = f"bin width taken to be {width_s * 1e12:g} ps: the file has none"
    return width_s, () if "bin_width_s" in options else (note,)


def _check_bins(options: dict, bins: int) -> None:
    """Refuse a `num_bins` that would drop photons in silence, where no gate says which."""
    given = options.get("num_bins", bins)
    require("gate" in options or finite("num_bins", given, "a number of bins") >= bins, "num_bins", given,
            f"{bins} or more, up to the file's last bin; or give a gate")
