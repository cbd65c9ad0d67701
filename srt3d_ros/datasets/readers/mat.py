"""Published .mat files of single-photon lidar, read unmodified; and others with an array of counts."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, MAX_PIXELS
from srt3d_ros.datasets.arrays import from_pixels
from srt3d_ros.datasets.files import read_errors
from srt3d_ros.datasets.options import check_same, few_bins_note, outside_note, refuse_channel
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers import hdf5, mat_child
from srt3d_ros.datasets.readers.cubes import GIVEN, cube, given_by, parts_of
from srt3d_ros.datasets.readers.mat_layouts import CELLS, LAYOUTS, WANTED, Layout
from srt3d_ros.datasets.recording import Recording
from srt3d_ros.datasets.values import MAX_PHOTONS, number
from srt3d_ros.errors import require

EDGE = 1e-6     # of a bin: a time on a bin's edge belongs to the bin that begins there, whatever the rounding


def read(path: Path, options: dict) -> Photons | Recording:
    """The photons of a .mat file; of its ToA, bins of the window that the file states, or those that have photons.

    Raises:
        InvalidInput: naming the file, variable or option that cannot be used.
    """
    if hdf5.is_matlab(path):
        return hdf5.read(path, options)
    refuse_channel(options)
    with read_errors(path):
        found = mat_child.load(path)
        layout = next((one for one in LAYOUTS if one.fits(found)), None)
        if layout is None:
            return _counts(path, found, options)
        for name in found.keys() & {*layout.window, layout.reference}:
            require(found[name].dtype.kind in "iuf", name, str(found[name].dtype), "numbers")
        return (_of_cells if layout.form == CELLS else _of_counts)(path, layout, found, options)


def _counts(path: Path, found: dict[str, np.ndarray], options: dict) -> Recording:
    """The only array of three dimensions, and what describes its sensor by the names of options."""
    cubes = [name for name, values in found.items() if values.ndim == 3]
    listed = found.get("listed", np.array(", ".join(found))).item()
    require(len(cubes) == 1, "variables", listed, f"one of {WANTED}")
    counts = found[cubes[0]]
    given, notes = given_by({name: found[name] for name in GIVEN if name in found}), few_bins_note(counts.shape)
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes)


def _of_counts(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Recording:
    """Counts of bins, whose pixels are in column-major order, and reference depths."""
    name, photons = layout.variable, found[layout.variable]
    width_s, notes = _bin_width(layout, options)
    require(bool(((photons >= 0) & (photons == np.floor(photons))).all()), name, "negative or fractional in places",
            "photons per bin")
    bins, pixels = photons.shape
    _check_bins(options, bins)
    require(layout.reference in found, layout.reference, "missing", "reference depths [rows, cols]")
    reference = found[layout.reference].astype(np.float32) - np.float32(1)
    require(reference.ndim == 2 and reference.size == pixels <= MAX_PIXELS, f"{layout.reference} shape",
            reference.shape, f"the {pixels} pixels of {name}, {MAX_PIXELS} at most")
    rows, cols = reference.shape
    counts, given = photons.reshape(bins, cols, rows).transpose(2, 1, 0), {"bin_width_s": width_s}
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes, reference)


def _of_cells(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Photons:
    """Lists of ToA, a cell for each pixel."""
    name, toa, lengths = layout.variable, found[layout.variable], found[f"{layout.variable}.lengths"]
    width_s, notes = _bin_width(layout, options)
    require(toa.dtype.kind in "iuf", f"{name} cells", str(toa.dtype), "lists of numbers")
    fits = lengths.ndim == 2 and 0 < lengths.size <= MAX_PIXELS
    require(fits, f"{name} shape", lengths.shape, f"1 to {MAX_PIXELS} pixels")
    require(lengths.sum() <= MAX_PHOTONS, f"{name} photons", lengths.sum(), f"at most {MAX_PHOTONS}")
    whole = layout.picoseconds or bool((toa == np.floor(toa)).all())
    require(whole, name, "fractional or not a number in places", "whole bins")
    unit = 1e-12 / width_s if layout.picoseconds else 1
    require(bool(((toa >= 0) & (toa * unit < 2**32)).all()), f"{name} ToA", "below 0 or beyond 2³² bins in places",
            "times of arrival from 0")
    toa = np.floor(toa * unit + EDGE).astype(np.int64)
    first, bins = _window(layout, found, unit, toa, options)
    first, last = options.get("gate", (first, first + bins - 1))
    require(last - first < MAX_BINS, "num_bins", last - first + 1, f"at most {MAX_BINS}: give a gate or bin_width_s")
    inside, pixel = (toa >= first) & (toa <= last), np.arange(lengths.size).repeat(lengths.ravel())
    shape = dict(zip(("rows", "cols"), lengths.shape))
    check_same(shape, options)
    own = shape | {"num_bins": last - first + 1, "bin_width_s": width_s,
                   "toa_offset_bins": options.get("toa_offset_bins", 0) + first}
    sensor, events, more = from_pixels(pixel[inside], toa[inside] - first, 0, options | own)
    outside = outside_note(len(toa) - events.photons, len(toa), first, last)
    return Photons(sensor, events, None, path.stem, notes + more + outside)


def _window(layout: Layout, found: dict[str, np.ndarray], unit: float, toa: np.ndarray, options: dict
            ) -> tuple[int, int]:
    """First bin and number of bins to keep: those the file states, else of `num_bins` or those that have photons."""
    given = int(number("num_bins", options.get("num_bins", 0), "a number of bins"))
    if all(name in found for name in layout.window or ("",)):
        low, high = (number(name, found[name].squeeze().tolist(), "one ToA") * unit for name in layout.window)
        first, end = int(np.floor(low + EDGE)), int(np.ceil(high - EDGE))
    else:
        _check_bins(options, int(toa.max(initial=-1)) + 1)
        first, end = (0, 0) if given or not toa.size else (int(toa.min()), int(toa.max()) + 1)
    return first, given or end - first


def _bin_width(layout: Layout, options: dict) -> tuple[float, tuple[str, ...]]:
    """The bin width that is given, or that of the authors with a note."""
    width_s = number("bin_width_s", options.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    note = f"bin width taken to be {width_s * 1e12:g} ps: the file has none"
    return width_s, () if "bin_width_s" in options else (note,)


def _check_bins(options: dict, bins: int) -> None:
    """Refuse a `num_bins` that would drop photons in silence, where no gate says which."""
    given = options.get("num_bins", bins)
    require("gate" in options or number("num_bins", given, "a number of bins") >= bins, "num_bins", given,
            f"{bins} or more, up to the file's last bin; or give a gate")
