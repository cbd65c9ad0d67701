"""Which axes of an array of counts are rows, columns and bins: by names, or by sizes."""

from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from srt3d_ros.datasets.options import AXES, FRAMES, Options
from srt3d_ros.errors import finite, require

SIZES = ("rows", "cols", "num_bins")
# Names of dimensions, as xarray gives them, and of columns.
DIMENSIONS = {"rows": {"row", "rows", "y", "v", "height", "line"}, "cols": {"col", "cols", "column", "x", "u", "width"},
              "bins": {"bin", "bins", "t", "time", "toa", "tof", "tdc", "delay", "nanotime"},
              FRAMES: {"frame", "frames"}}


class Ordered(NamedTuple):
    """Counts [rows, cols, bins] of a frame, the options that were not needed, notes, and the number of frames."""

    counts: np.ndarray
    options: Options
    notes: tuple[str, ...] = ()
    frames: int = 1


def in_order(counts: np.ndarray, options: Options, stated: dict[str, Any], dims: tuple[str, ...] = ()) -> Ordered:
    """The counts of a frame [rows, cols, bins] by the option `axes`, by names of dimensions, or by the stated sizes.

    Args:
        counts: of three axes; or of four, of which one is 1, or which has frames (the first one, unless named).
        stated: what the file says of its sensor, by the names of options; options win.
        dims: names of the dimensions, if there are any.

    Raises:
        InvalidInput: no order fits the sizes, or several do.
    """
    axes = options.axes or _named(dims, counts.ndim)
    if counts.ndim not in (3, 4):
        return Ordered(counts, options.without("axes"))
    counts, axes, notes, frames = _frame(counts, axes, options)
    options, known, shape = options.without("axes"), stated | options.known, counts.shape
    sizes = {name: int(finite(name, known[name])) for name in SIZES if known.get(name) is not None}
    said = ", ".join(f"{name} = {size}" for name, size in sizes.items())
    names = [axes] if axes else [*permutations(AXES)]       # of the array's axes; that of AXES is the first
    names = [one for one in names if all(shape[one.index(name)] == sizes.get(name, shape[one.index(name)])
                                         for name in SIZES[:2])]
    require(len(names) > 0, "counts shape", " × ".join(map(str, shape)), f"axes that fit {said}")
    exact = [one for one in names if shape[one.index("bins")] == sizes.get("num_bins")]
    names = exact or names
    if names[0] != AXES:
        fitting, text = [",".join(one) for one in names], f"{' × '.join(map(str, shape))} counts"
        require(len(names) == 1, "axes",
                problem=f"The axes of {text} may be {' or '.join(fitting)} ({said}): give axes (--axes).")
        notes += () if axes else (f"axes of {text} taken to be {fitting[0]}: {said}",)
        counts = counts.transpose([names[0].index(name) for name in AXES])
    elif not (axes or exact or sizes.keys() >= {*SIZES[:2]}) and (doubt := _doubt(shape)):
        irf = options.known.get("irf")
        require(irf is None or irf.shape[-1] <= shape[2], "axes",
                problem=f"The IRF is longer than the period: {doubt}.")
        notes += (doubt,)
    return Ordered(counts, options, notes, frames)


def _named(dims: tuple[str, ...], axes: int) -> tuple[str, ...]:
    """The axes that the names of the dimensions mean; none unless all are known."""
    found = [next((axis for axis, names in DIMENSIONS.items() if dim.lower() in names), "") for dim in dims]
    return tuple(found) if {*found} in ({*AXES}, {*AXES, FRAMES}) and len(found) == axes else ()


def _frame(counts: np.ndarray, axes: tuple[str, ...], options: Options
           ) -> tuple[np.ndarray, tuple[str, ...], tuple[str, ...], int]:
    """The counts of the frame, of three axes, their names if known, a note on a choice, and the number of frames."""
    if counts.ndim == 3:
        require(FRAMES not in axes, "axes", ",".join(axes), "three axes")
        return counts, axes, (), 1
    of_frames = axes.index(FRAMES) if FRAMES in axes else counts.shape.index(1) if 1 in counts.shape else 0
    frames, axes = counts.shape[of_frames], tuple(name for name in axes if name != FRAMES)
    require(options.frame < frames, "frame", options.frame, f"less than {frames}, the size of axis {of_frames}")
    notes = () if frames == 1 or options.frame else (f"frame 0 of {frames} (--frame)",)
    return counts.take(options.frame, of_frames) if of_frames else counts[options.frame], axes, notes, frames


def _doubt(shape: tuple[int, ...]) -> str:
    """A note if another axis may have the bins: one that is longest, or the first one in front of a square."""
    first, middle, bins = shape
    orders = ["bins,rows,cols, or bins,cols,rows as MATLAB's h5write has it"
              ] * (first > max(middle, bins) or (middle == bins > first > 1) or (first == middle > bins > 1))
    orders += ["rows,bins,cols"] * (middle > max(first, bins) or (first == middle > bins > 1))
    return " × ".join(map(str, shape)) + (" taken for rows × cols × bins: if another axis has the bins, give axes="
                                          f"{'; or '.join(orders)} (--axes); of the words of a SPAD array [frames, "
                                          "rows, cols], give no_detection (--no-detection)") if orders else ""
