"""Read published .mat files of single-photon lidar as they are, and other .mat files with an array of counts."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, MAX_PIXELS
from srt3d_ros.datasets import named_arrays
from srt3d_ros.datasets.arrays import MAX_KEPT, are_whole
from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.reading import in_gate
from srt3d_ros.datasets.values import MAX_EVENTS, Note, outside_note
from srt3d_ros.errors import finite, require
from srt3d_ros.files import isolated
from srt3d_ros.files.array_files import read_errors

REFERENCE = named_arrays.FIRST_REFERENCES[-1]
EDGE = 1e-6     # of a bin; added to a time before it is rounded down, so that an edge belongs to the bin it begins


class Layout(NamedTuple):
    """Where a published kind of file has its photons: in [rows, cols] cells of ToA lists, or in [T, rows · cols]
    counts, whose pixels are in MATLAB's column-major order."""

    variable: str               # array of photons
    bin_width_s: float          # that the authors state, or that follows from their description
    reference: str = ""         # array [rows, cols] of reference depths, counted from 1; with counts only
    picoseconds: bool = False   # ToA are in picoseconds instead of bins
    window: tuple[str, ...] = ()        # scalars with the first and last ToA of the measured window

    def fits(self, arrays: dict[str, np.ndarray]) -> bool:
        """Whether a file has its photons in this layout."""
        photons = arrays.get(self.variable, np.zeros(0))
        counts = photons.dtype.kind in "iuf" and (photons.ndim == 2 or f"{self.variable}.shape" in arrays)
        return counts if self.reference else f"{self.variable}.lengths" in arrays


LAYOUTS = (
    Layout("Y", 16e-12, "DepthImage"),              # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                  # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                            # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    # USTC, tower at 9.8 km (Li et al., Optica 2021); the bin width is our choice
    Layout("data_processed", 100e-12, picoseconds=True, window=("mm", "MM")),
    Layout("spad", 80e-12, "bin"),                  # simulated, sparse: Lindell et al., SIGGRAPH 2018
)
WANTED = "; ".join(["one of " + ", ".join(f"{one.variable} ({'[T, rows·cols] counts' if one.reference else 'cells'})"
                                         for one in LAYOUTS), named_arrays.WANTED])
VARIABLES = (*(name for one in LAYOUTS for name in (one.variable, one.reference, *one.window) if name),
             *named_arrays.KNOWN)


def read(path: Path, options: Options) -> Content:
    """Photons of a .mat file. The bins are those of the file's window, or those that have photons."""
    arrays, listed = isolated.matlab_arrays(path, (*VARIABLES, *options.named))
    layout = next((one for one in LAYOUTS if one.fits(arrays)), None)
    if layout is None or options.named:
        return Content(arrays, options, (), listed, WANTED)
    with read_errors(path):
        for name in arrays.keys() & {*layout.window, layout.reference}:
            require(arrays[name].dtype.kind in "iuf", name, str(arrays[name].dtype), "numbers")
        found = (_of_counts if layout.reference else _of_cells)(layout, arrays, options)
        note = Note(f"bin width taken to be {layout.bin_width_s * 1e12:g} ps: the file has none", "bin_width_s")
        return found._replace(arrays=found.arrays | {"bin_width_s": layout.bin_width_s}, notes=(note, *found.notes))


def _of_counts(layout: Layout, arrays: dict[str, np.ndarray], options: Options) -> Content:
    """Photons of counts [T, rows · cols] with reference depths. Sparse counts stay sparse."""
    name, photons = layout.variable, arrays[layout.variable]
    require(are_whole(np.atleast_2d(photons)), name, problem=f"{name} has negative or fractional counts.")
    bins, pixels = photons.shape if photons.ndim == 2 else arrays[f"{name}.shape"][::-1].tolist()
    require(layout.reference in arrays, layout.reference,
            problem=f"{name} needs the reference depths {layout.reference} [rows, cols].")
    reference = arrays[layout.reference].astype(np.float32) - np.float32(1)
    require(reference.ndim == 2 and reference.size == pixels <= MAX_PIXELS, f"{layout.reference} shape",
            reference.shape, f"the {pixels} pixels of {name}, {MAX_PIXELS} at most")
    rows, cols = reference.shape
    if photons.ndim == 2:
        counts = photons.reshape(bins, cols, rows).transpose(2, 1, 0)
        return Content({"counts": counts, "rows": rows, "cols": cols, REFERENCE: reference}, options)
    total, toa = photons.sum(dtype=np.float64), arrays[f"{name}.col"]
    require(total <= MAX_KEPT, f"{name} photons", total, f"at most {MAX_KEPT} in a sparse array: save full({name})")
    col, row = np.divmod(arrays[f"{name}.row"], rows)
    order = np.lexsort((toa, row * cols + col))
    pixel, toa = (values[order].repeat(photons[order].astype(np.int64)) for values in (row * cols + col, toa))
    return _of_events(pixel, toa, (0, bins - 1), options, {"rows": rows, "cols": cols, REFERENCE: reference})


def _of_cells(layout: Layout, arrays: dict[str, np.ndarray], options: Options) -> Content:
    """Photons of ToA lists, one cell a pixel."""
    name, toa, lengths = layout.variable, arrays[layout.variable], arrays[f"{layout.variable}.lengths"]
    require(lengths.ndim == 2 and 0 < lengths.size <= MAX_PIXELS, f"{name} shape", lengths.shape,
            f"[rows, cols], 1 to {MAX_PIXELS} pixels")
    require(toa.dtype.kind in "iuf", f"{name} cells", str(toa.dtype), "lists of numbers")
    require(toa.size <= MAX_EVENTS, f"{name} photons", toa.size, f"at most {MAX_EVENTS}")
    whole = layout.picoseconds or bool((toa == np.floor(toa)).all())
    require(whole, name, problem=f"{name} has times that are not whole bins.")
    width_s = finite("bin_width_s", options.known.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    unit = 1e-12 / width_s if layout.picoseconds else 1
    require(bool(((toa >= 0) & (toa * unit < 2**32)).all()), f"{name} ToA",
            problem=f"{name} has times of arrival below 0 or beyond 2³² bins.")
    bins = np.floor(toa * unit + EDGE).astype(np.int64)
    if layout.window and arrays.keys() >= {*layout.window}:
        low, high = (finite(name, arrays[name].squeeze().tolist(), "one ToA") * unit for name in layout.window)
        measured = int(np.floor(low + EDGE)), int(np.ceil(high - EDGE)) - 1
    else:
        measured = 0 if "num_bins" in options.known else int(bins.min(initial=2**32)), int(bins.max(initial=0))
    pixel, (rows, cols) = np.arange(lengths.size).repeat(lengths.ravel()), lengths.shape
    return _of_events(pixel, bins, measured, options, {"rows": rows, "cols": cols})


def _of_events(pixel: np.ndarray, toa: np.ndarray, measured: tuple[int, int], options: Options,
               arrays: dict[str, Any]) -> Content:
    """Photons inside the gate, or else in the bins `measured` = (first, last), or num_bins from the first on."""
    first, last = options.gate or measured
    if options.gate is None and "num_bins" in options.known:
        last = first + int(finite("num_bins", options.known["num_bins"], "a number of bins")) - 1
    num_bins = last - first + 1
    require(num_bins <= MAX_BINS, "num_bins", num_bins, f"at most {MAX_BINS}: give a gate or bin_width_s")
    options = options.knowing(num_bins=num_bins, toa_offset_bins=options.known.get("toa_offset_bins", 0) + first)
    inside = (toa >= first) & (toa <= last)
    if REFERENCE in arrays:
        arrays[REFERENCE] = in_gate(arrays[REFERENCE], first, last)
    return Content(arrays | {"pixel": pixel[inside], "toa": toa[inside] - first}, options.without("gate"),
                   outside_note(len(toa) - np.count_nonzero(inside), len(toa), first, last))
