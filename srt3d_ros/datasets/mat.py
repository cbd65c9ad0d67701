"""The .mat files that single-photon lidar data are published in, read unmodified; and others with an array of counts.

A published file is recognised by the name and form of a variable: to read another one, add its `Layout`. scipy reads
them in a child process: its reader trusts the file, and some files end the process that reads them.
"""

import warnings
from math import isqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor import MAX_PIXELS
from srt3d_ros.datasets import hdf5
from srt3d_ros.datasets.cubes import GIVEN, cube, given_by, parts_of
from srt3d_ros.datasets.files import in_child, naming_file
from srt3d_ros.datasets.photons import MAX_PHOTONS, number, positive_integer, refuse_channel
from srt3d_ros.datasets.stream import Events, Recording
from srt3d_ros.errors import require

EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
MAX_MEMORY_BYTES = 5 * 2**30     # the most photons in 8 bytes each, in their cells and joined; the rest for the reader
MAX_SECONDS = 600.0             # fifteen times what files that fill this memory take
EDGE = 1e-6     # of a bin: a time on a bin's edge belongs to the bin that begins there, whatever the rounding
CELLS, COUNTS, SPARSE = "[rows, cols] cell", "[T, rows·cols] counts", "sparse [rows·cols, T] counts"
CUBE = "any other numeric array [rows, cols, bins]"


class Layout(NamedTuple):
    """How one published kind of file holds its photons.

    Args:
        variable: name of the array of photons.
        bin_width_s: where the file does not say; what the authors say, or inferred from their description.
        form: CELLS of ToA lists, COUNTS of photons per bin or SPARSE ones; pixels of counts in MATLAB's column-major
            order.
        picoseconds: ToA are times in picoseconds, not bins.
        window: scalars that hold the first and last ToA of the measured window.
        reference: array [rows, cols] of reference depths, numbered from 1 as MATLAB does.
    """

    variable: str
    bin_width_s: float
    form: str = CELLS
    picoseconds: bool = False
    window: tuple[str, ...] = ()
    reference: str = ""

    def fits(self, photons: object) -> bool:
        """Whether this is what scipy reads the variable of such a file as."""
        if self.form == SPARSE:
            return hasattr(photons, "tocoo")
        kinds = "O" if self.form == CELLS else "iuf"
        return isinstance(photons, np.ndarray) and photons.ndim == 2 and photons.dtype.kind in kinds


LAYOUTS = (
    Layout("Y", 16e-12, COUNTS, reference="DepthImage"),        # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                              # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                                        # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    Layout("data_processed", 100e-12, picoseconds=True,         # USTC, tower at 9.8 km (Li et al., Optica 2021);
           window=("mm", "MM")),                                # the bin width is our choice
    Layout("spad", 80e-12, SPARSE, reference="bin"),            # simulated: Lindell et al., SIGGRAPH 2018
)


def read(path: Path, options: dict) -> Recording:
    """The photons of a .mat file; of its ToA, bins of the window that the file states, or those that have photons.

    Raises:
        InvalidInput: naming the file, variable or option that cannot be used.
    """
    if hdf5.is_matlab(path):
        return hdf5.read(path, options)
    refuse_channel(options)
    with naming_file(path):
        found = in_child(variables_of, path, expected=EXPECTED, memory_bytes=MAX_MEMORY_BYTES, timeout_s=MAX_SECONDS)
        index = found.pop("layout").item()
        if index < 0:
            counts = found.pop("counts")
            return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given_by(found))
        return _recording(path, LAYOUTS[index], found, options)


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


def variables_of(path: str) -> dict[str, np.ndarray]:
    """For a child process: the variables of the layout that fits, and `layout`, its index, or -1 if none does.

    Of cells their content, one after the other, with `pixel` and `size`, [rows, cols]. Of counts their `size`, pixels
    and bins; of sparse ones pixel and bin of each photon. Without a layout `counts` [rows, cols, bins], and what
    describes the sensor.

    Raises:
        InvalidInput: nothing fits, or the photons are too many or no numbers.
    """
    from scipy.io import loadmat

    warnings.simplefilter("ignore")
    names = {name for one in LAYOUTS for name in (one.variable, *one.window, one.reference) if name}
    content = loadmat(path, variable_names=names)
    index = next((k for k, one in enumerate(LAYOUTS) if one.fits(content.get(one.variable))), -1)
    if index < 0:
        return _other_counts(path) | {"layout": np.array(index)}
    layout = LAYOUTS[index]
    photons = content[layout.variable]
    own = {CELLS: _of_cells, SPARSE: _of_sparse, COUNTS: _of_counts}[layout.form](layout.variable, photons)
    for name in filter(content.__contains__, (*layout.window, layout.reference)):
        own[name] = np.asarray(content[name])
        require(own[name].dtype.kind in "iuf", name, str(own[name].dtype), "numbers")
        require(own[name].size == 1 or name not in layout.window, f"{name} shape", own[name].shape, "one number")
    return own | {"layout": np.array(index)}


def _of_counts(name: str, counts: np.ndarray) -> dict[str, np.ndarray]:
    _check_whole(name, counts)
    return {name: counts, "size": np.array(counts.shape[::-1])}


def _of_sparse(name: str, counts) -> dict[str, np.ndarray]:
    require(counts.shape[0] <= MAX_PIXELS, f"{name} pixels", counts.shape[0], f"at most {MAX_PIXELS}")
    found = counts.tocoo()
    photons = found.data.astype(np.float64)
    _check_whole(name, photons)
    _check_number(name, photons.sum())
    photons = photons.astype(np.int64)
    return {name: found.col.repeat(photons), "pixel": found.row.repeat(photons), "size": np.array(counts.shape)}


def _check_whole(name: str, photons: np.ndarray) -> None:
    require(bool(((photons >= 0) & (photons == np.floor(photons))).all()), name, "negative or fractional in places",
            "photons per bin")


def _of_cells(name: str, cells: np.ndarray) -> dict[str, np.ndarray]:
    require(0 < cells.size <= MAX_PIXELS, f"{name} shape", cells.shape, f"1 to {MAX_PIXELS} pixels")
    lengths = np.fromiter((cell.size for cell in cells.flat), np.int64, cells.size)
    _check_number(name, lengths.sum())
    for cell in cells.flat:
        fits = isinstance(cell, np.ndarray) and (cell.dtype.kind in "iuf" or not cell.size)
        require(fits, f"{name} cells", f"{type(cell).__name__} of {getattr(cell, 'dtype', '')}", "lists of numbers")
    toa = np.concatenate([np.zeros(0, np.int64), *(cell.ravel() for cell in cells.flat if cell.size)])
    return {name: toa, "pixel": np.arange(cells.size).repeat(lengths), "size": np.array(cells.shape)}


def _check_number(name: str, photons: float) -> None:
    require(photons <= MAX_PHOTONS, f"{name} photons", photons, f"at most {MAX_PHOTONS}")


def _other_counts(path: str) -> dict[str, np.ndarray]:
    """The only numeric array of three dimensions of a file, and what describes its sensor by the names of options."""
    from scipy.io import loadmat, whosmat

    try:
        listed = whosmat(path)
    except TypeError:       # at objects of classes, which loadmat leaves out
        listed = []
    cubes = [name for name, shape, kind in listed if len(shape) == 3 and kind not in ("cell", "struct")]
    words = ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in listed)
    forms = "; ".join([*(f"{one.variable} ({one.form})" for one in LAYOUTS), CUBE])
    require(len(cubes) == 1, "variables", words if listed else "others, some of them objects", f"one of {forms}")
    content = loadmat(path, variable_names=[*cubes, *GIVEN])
    found = {"counts": content[cubes[0]]} | {name: content[name] for name in GIVEN if name in content}
    for name, values in found.items():
        require(isinstance(values, np.ndarray) and values.dtype.kind in "iufbU", name, type(values).__name__, "numbers")
    return found
