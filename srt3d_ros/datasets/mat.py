"""The .mat files that single-photon lidar data are published in, read unmodified.

A file is recognised by the name and shape of its variables. To read another published file, add its `Layout` in
mat_variables.py.
scipy reads them in a child process: its reader trusts the file, and some files end the process that reads them.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.bounded_call import ChildFailed, call
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import MAX_BINS, MAX_PIXELS, SensorModel
from srt3d_ros.datasets.cubes import cube, given_by, parts_of
from srt3d_ros.datasets.files import naming_file, require_file
from srt3d_ros.datasets.mat_variables import EXPECTED, LAYOUTS, Layout, variables_of
from srt3d_ros.datasets.photons import MAX_PHOTONS, Photons, described, gate_events, number
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import InvalidInput, require

MAX_MEMORY_BYTES = 5 * 2**30     # the most photons in 8 bytes each, in their cells and joined; the rest for the reader
MAX_SECONDS = 600.0             # fifteen times what files that fill this memory take
EDGE = 1e-6     # of a bin: a time on a bin's edge belongs to the bin that begins there, whatever the rounding


def read(path: str | Path, options: dict, guess_irf: bool = False) -> Photons | Recording:
    """The photons of a published .mat file, or an array of counts; `options` (photons.gather_options) tell the rest.

    `num_bins`, `gate`: T and the first bin that are kept. Without a gate, the file's own window; without that, bins
    0 to num_bins; without that, the smallest to the largest ToA. `toa_offset_bins` counts up to the file's own bin 0;
    the window's first bin is added to it.

    Raises:
        InvalidInput: naming the file, variable or option that cannot be used.
    """
    path = Path(path)
    require_file(path, "photon file")
    with naming_file(path):
        layout, variables = _load(path)
    if layout is None:
        counts = variables.pop("counts")
        return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given_by(variables))
    width_s = number("bin_width_s", options.get("bin_width_s", layout.bin_width_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    notes = () if "bin_width_s" in options else (f"bin width taken to be {width_s * 1e12:g} ps: the file has none",)
    with naming_file(path):
        unpack = _from_sparse if layout.sparse else _from_counts if layout.counts else _from_cells
        content = unpack(layout, variables, options)
        toa = _to_bins(layout, content.toa, width_s)
    first, bins, may_drop = _window(layout, variables, options, width_s, toa, content.bins)
    events, dropped = gate_events(PhotonEvents(content.pixel, toa), first, bins)
    require(may_drop or not dropped, "num_bins", bins, f"above {toa.max(initial=0)}, the largest ToA; or give a gate")
    plain = SensorModel(content.rows, content.cols, bins, width_s, np.ones(1))
    sensor, assumed = described(plain, options, events, first, guess_irf)
    reference = _reference(layout, variables, first, bins, (content.rows, content.cols))
    if reference is not None:       # these are numbers of bins
        reference = reference + np.float32(sensor.first_bin_center)
    return Photons(sensor, events, reference, path.stem, notes + dropped + assumed)


class _Content(NamedTuple):
    """What a file holds: ToA as the file counts them, and the bins of its histograms if it has such."""

    rows: int
    cols: int
    pixel: np.ndarray
    toa: np.ndarray
    bins: int | None


def _load(path: Path) -> tuple[Layout | None, dict[str, np.ndarray]]:
    """The layout of a file, None for other counts, and its variables, as `variables_of` gives them."""
    try:
        variables = call(variables_of, str(path), memory_bytes=MAX_MEMORY_BYTES, timeout_s=MAX_SECONDS)
    except ChildFailed as error:
        raise InvalidInput("", f"unreadable (its reader {error})", EXPECTED) from None
    index = variables.pop("layout").item()
    return LAYOUTS[index] if index >= 0 else None, variables


def _from_counts(layout: Layout, variables: dict, options: dict) -> _Content:
    counts = variables[layout.variable]
    bins, pixels = counts.shape
    rows, cols = _counted_shape(layout, variables, options, pixels)
    _check_counts(layout, counts)
    by_pixel = np.ascontiguousarray(counts.reshape(bins, cols, rows).transpose(2, 1, 0)).ravel()
    at = np.flatnonzero(by_pixel)
    photons = by_pixel[at].astype(np.int64)
    pixel, toa = np.divmod(at, bins)
    return _Content(rows, cols, np.repeat(pixel.astype(np.uint32), photons), np.repeat(toa, photons), bins)


def _from_sparse(layout: Layout, variables: dict, options: dict) -> _Content:
    pixels, bins = variables["size"][0].tolist()
    require(pixels <= MAX_PIXELS, f"{layout.variable} pixels", pixels, f"at most {MAX_PIXELS}")
    rows, cols = _counted_shape(layout, variables, options, pixels)
    pixel, toa, photons = variables[layout.variable]
    _check_counts(layout, photons)
    col, row = np.divmod(pixel.astype(np.int64), rows)
    pixel = row * cols + col
    order = np.lexsort((toa, pixel))
    photons = photons[order].astype(np.int64)
    return _Content(rows, cols, pixel[order].astype(np.uint32).repeat(photons),
                    toa[order].astype(np.int64).repeat(photons), bins)


def _check_counts(layout: Layout, counts: np.ndarray) -> None:
    require(bool((counts >= 0).all() and (counts == np.floor(counts)).all()), layout.variable,
            "negative or fractional in places", "photons per bin")
    total = float(counts.sum(dtype=np.float64))
    require(total <= MAX_PHOTONS, f"{layout.variable} photons", total, f"at most {MAX_PHOTONS}")


def _counted_shape(layout: Layout, variables: dict, options: dict, pixels: int) -> tuple[int, int]:
    """Rows and columns of a counts array: the options', the reference's, or square."""
    side = int(np.sqrt(pixels))
    shape = getattr(variables.get(layout.reference), "shape", (side, side))
    expected = f"rows and cols whose product is the {pixels} pixels of {layout.variable}"
    rows, cols = (number(name, options.get(name, own), expected) for name, own in zip(("rows", "cols"), shape))
    whole = rows == int(rows) > 0 and cols == int(cols) > 0
    require(whole and rows * cols == pixels, "rows, cols", f"{rows:g}, {cols:g}", expected)
    return int(rows), int(cols)


def _from_cells(layout: Layout, variables: dict, options: dict) -> _Content:
    toa, lengths = variables[layout.variable], variables["lengths"]
    rows, cols = lengths.shape
    require(options.get("rows", rows) == rows and options.get("cols", cols) == cols, "rows, cols",
            f"{options.get('rows', rows)}, {options.get('cols', cols)}", f"{rows}, {cols}, as in the file")
    whole = layout.picoseconds or toa.dtype.kind != "f" or bool((toa == np.floor(toa)).all())
    require(whole and bool(np.isfinite(toa).all()), layout.variable, "fractional or not finite in places", "whole bins")
    pixel = np.repeat(np.arange(lengths.size, dtype=np.uint32), lengths.ravel())
    return _Content(rows, cols, pixel, toa, None)


def _to_bins(layout: Layout, toa: np.ndarray, width_s: float) -> np.ndarray:
    """ToA as the file counts them → 0-based bins, uint32."""
    if layout.picoseconds:
        toa = np.floor(toa * (1e-12 / width_s) + EDGE)
    elif not layout.counts:
        toa = toa.astype(np.int64)
    require(len(toa) == 0 or 0 <= toa.min() <= toa.max() < 2**32, f"{layout.variable} ToA",
            "below 0 or beyond 2³² bins in places", "times of arrival from 0")
    return toa.astype(np.uint32)


def _window(layout: Layout, variables: dict, options: dict, width_s: float, toa: np.ndarray,
            bins_in_file: int | None) -> tuple[int, int, bool]:
    """First bin and number of bins to keep, and whether photons outside may be dropped."""
    if "gate" in options:
        return *options["gate"], True
    given = int(number("num_bins", options.get("num_bins", 0), "a number of bins"))
    if layout.window and all(name in variables for name in layout.window):
        unit = 1e-12 / width_s if layout.picoseconds else 1
        low, high = (number(name, float(variables[name].item()) * unit, "a ToA") for name in layout.window)
        first, may_drop = int(np.floor(low + EDGE)), True
        bins = given or int(np.ceil(high - EDGE)) - first
    elif given or bins_in_file:
        first, bins, may_drop = 0, given or bins_in_file, False
    else:
        first, may_drop = int(toa.min(initial=2**32 - 1)), False
        bins = int(toa.max(initial=0)) - first + 1
    require(first >= 0 and 2 <= bins <= MAX_BINS, "num_bins", bins,
            f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
    return first, bins, may_drop


def _reference(layout: Layout, variables: dict, first: int, bins: int, shape: tuple[int, int]) -> np.ndarray | None:
    if layout.reference not in variables:
        return None
    depth = np.asarray(variables[layout.reference], dtype=np.float32) - np.float32(1 + first)
    require(depth.shape == shape, f"{layout.reference} shape", depth.shape, f"{shape}")
    return np.where((depth >= 0) & (depth < bins), depth, np.float32(np.nan))[None]
