"""Published .mat files of single-photon lidar, read unmodified; and others with an array of counts."""

from math import isqrt
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_PIXELS
from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.options import few_bins_note, refuse_channel
from srt3d_ros.datasets.readers import hdf5, mat_child
from srt3d_ros.datasets.readers.cubes import GIVEN, cube, given_by, parts_of
from srt3d_ros.datasets.readers.mat_layouts import CELLS, COUNTS, LAYOUTS, SPARSE, WANTED, Layout
from srt3d_ros.datasets.recording import Events, Recording
from srt3d_ros.datasets.values import MAX_PHOTONS, number, positive_integer
from srt3d_ros.errors import require

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
        found = mat_child.load(path)
        layout = next((one for one in LAYOUTS if one.fits(found)), None)
        return _counts(path, found, options) if layout is None else _published(path, layout, found, options)


def _counts(path: Path, found: dict[str, np.ndarray], options: dict) -> Recording:
    """The only array of three dimensions, and what describes its sensor by the names of options."""
    cubes = [name for name, values in found.items() if values.ndim == 3]
    listed = found.get("listed", np.array(", ".join(found))).item()
    require(len(cubes) == 1, "variables", listed, f"one of {WANTED}")
    counts = found[cubes[0]]
    given = given_by({name: values for name, values in found.items() if name in GIVEN})
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, few_bins_note(counts.shape))


def _published(path: Path, layout: Layout, found: dict[str, np.ndarray], options: dict) -> Recording:
    width_s = number("bin_width_s", options.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    notes = () if "bin_width_s" in options else (f"bin width taken to be {width_s * 1e12:g} ps: the file has none",)
    for name in found.keys() & {*layout.window, layout.reference}:
        require(found[name].dtype.kind in "iuf", name, str(found[name].dtype), "numbers")
    photons, reference, given = found[layout.variable], found.get(layout.reference), {"bin_width_s": width_s}
    if layout.form == CELLS:
        pixel, toa, (rows, cols) = _of_cells(layout, found, width_s, options)
        first, bins = _window(layout, found, width_s, toa, options)
        given["gate"] = first, first + bins - 1
    else:
        pixels, bins = found[f"{layout.variable}.shape"].tolist() if layout.form == SPARSE else photons.shape[::-1]
        _check_bins(options, bins)
        require(pixels <= MAX_PIXELS, f"{layout.variable} pixels", pixels, f"at most {MAX_PIXELS}")
        _check_whole(layout.variable, photons)
        rows, cols = _counted_shape(pixels, reference, options, layout)
    if reference is not None:
        require(reference.shape == (rows, cols), f"{layout.reference} shape", reference.shape, f"{(rows, cols)}")
        reference = reference.astype(np.float32) - np.float32(1)
    if layout.form == COUNTS:
        counts = photons.reshape(bins, cols, rows).transpose(2, 1, 0)
        return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes, reference)
    if layout.form == SPARSE:
        _check_number(layout.variable, photons.sum(dtype=np.float64))
        photons = photons.astype(np.int64)
        col, row = np.divmod(found[f"{layout.variable}.row"].repeat(photons), rows)
        toa, pixel = found[f"{layout.variable}.col"].repeat(photons), row * cols + col
        order = np.lexsort((toa, pixel))
        toa, pixel = toa[order], pixel[order]
    return Recording(rows, cols, bins, width_s, lambda: iter([Events(pixel, toa, 1.0)]), path.stem, notes, given,
                     reference)


def _of_cells(layout: Layout, found: dict[str, np.ndarray], width_s: float, options: dict) -> tuple:
    """Pixel and bin of each photon, and rows and cols."""
    name, toa, lengths = layout.variable, found[layout.variable], found[f"{layout.variable}.lengths"]
    require(toa.dtype.kind in "iuf", f"{name} cells", str(toa.dtype), "lists of numbers")
    require(lengths.ndim == 2 and 0 < lengths.size <= MAX_PIXELS, f"{name} shape", lengths.shape,
            f"1 to {MAX_PIXELS} pixels")
    _check_number(name, lengths.sum())
    own = tuple(options.get(side, size) for side, size in zip(("rows", "cols"), lengths.shape))
    require(own == lengths.shape, "rows, cols", own, f"{lengths.shape}, as in the file")
    whole = layout.picoseconds or bool((toa == np.floor(toa)).all())
    require(whole, name, "fractional or not a number in places", "whole bins")
    unit = 1e-12 / width_s if layout.picoseconds else 1
    require(bool(((toa >= 0) & (toa * unit < 2**32)).all()), f"{name} ToA", "below 0 or beyond 2³² bins in places",
            "times of arrival from 0")
    return np.arange(lengths.size).repeat(lengths.ravel()), np.floor(toa * unit + EDGE).astype(np.int64), lengths.shape


def _window(layout: Layout, found: dict[str, np.ndarray], width_s: float, toa: np.ndarray, options: dict
            ) -> tuple[int, int]:
    """First bin and number of bins to keep: those the file states, else of `num_bins` or those that have photons."""
    given = int(number("num_bins", options.get("num_bins", 0), "a number of bins"))
    stated = [found[name] for name in layout.window if name in found]
    for name in filter(found.__contains__, layout.window):
        require(found[name].size == 1, f"{name} shape", found[name].shape, "one number")
    if len(stated) == 2:
        low, high = (number("window", value.item() * (1e-12 / width_s), "a ToA") for value in stated)
        first, end = int(np.floor(low + EDGE)), int(np.ceil(high - EDGE))
    else:
        _check_bins(options, int(toa.max(initial=-1)) + 1)
        first, end = (0, 0) if given or not toa.size else (int(toa.min()), int(toa.max()) + 1)
    require(first >= 0, "window", f"from bin {first}", "a window from bin 0 or later")
    return first, given or end - first


def _counted_shape(pixels: int, reference: np.ndarray | None, options: dict, layout: Layout) -> tuple[int, int]:
    """Rows and columns of an array of counts: the options', the reference's, or square."""
    own = (isqrt(pixels),) * 2 if reference is None else reference.shape
    rows, cols = (positive_integer(name, options.get(name, size)) for name, size in zip(("rows", "cols"), own))
    require(rows * cols == pixels, "rows, cols", f"{rows}, {cols}",
            f"rows and cols whose product is the {pixels} pixels of {layout.variable}")
    return rows, cols


def _check_bins(options: dict, bins: int) -> None:
    """Refuse a `num_bins` that would drop photons in silence, where no gate says which."""
    given = options.get("num_bins", bins)
    require("gate" in options or number("num_bins", given, "a number of bins") >= bins, "num_bins", given,
            f"{bins} or more, up to the file's last bin; or give a gate")


def _check_whole(name: str, photons: np.ndarray) -> None:
    require(bool(((photons >= 0) & (photons == np.floor(photons))).all()), name, "negative or fractional in places",
            "photons per bin")


def _check_number(name: str, photons: float) -> None:
    require(photons <= MAX_PHOTONS, f"{name} photons", photons, f"at most {MAX_PHOTONS}")
