"""Arrays of counts [rows, cols, bins] in .npy and .npz files, streamed by rows."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.files import map_npy, npz_headers, open_npz, read_errors, read_npz_arrays
from srt3d_ros.datasets.options import ASSUMED_WIDTH, BIN_OF_ONE_METRE_S, few_bins_note
from srt3d_ros.datasets.recording import Counts, Recording
from srt3d_ros.datasets.values import number
from srt3d_ros.errors import require

CHUNK_BYTES = 2**25         # of counts that are read at once, or one row if that is more
MAX_ROW_BYTES = 2**29
MAX_CUBE_BYTES = 2**46
MAX_COUNT = 2**31 - 1
NAMES = ("counts", "cube", "histograms", "data")        # of the array that is meant, if there are several
GIVEN = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "toa_reference", "fov_deg")


def cube(path: Path, shape: tuple[int, ...], dtype: np.dtype, read: Callable[[int], Iterator[np.ndarray]],
         options: dict, given: dict | None = None, notes: tuple[str, ...] = (), reference: np.ndarray | None = None
         ) -> Recording:
    """The recording that an array of counts is.

    Args:
        shape: [rows, cols, bins], or [pixels, bins], whose rows and cols `options` tell; else all are in one row.
        read: gives the array, so many rows (or pixels) at a time.
        given, reference: what the file itself says, see Recording.
    """
    field, given = f"{path.name} counts", given or {}
    require(dtype.kind in "iufb" and len(shape) in (2, 3) and min(shape) > 0, field, f"{dtype} {shape}",
            "numbers [rows, cols, bins] or [pixels, bins]")
    own = shape[:2] if len(shape) == 3 else (1, shape[0])
    rows, cols = (int(number(name, options.get(name, size), "an integer")) for name, size in zip(("rows", "cols"), own))
    require(rows * cols == own[0] * own[1] and (len(shape) == 2 or rows == own[0]), "rows, cols", f"{rows}, {cols}",
            f"those of the file's array, {' × '.join(map(str, shape[:-1]))}")
    bins = shape[-1]
    require(bins <= MAX_BINS or "gate" in options, f"{field} bins", bins, f"at most {MAX_BINS}; or give a gate")
    width = (given | options).get("bin_width_s")
    notes += (ASSUMED_WIDTH,) * (width is None)
    width_s = BIN_OF_ONE_METRE_S if width is None else number("bin_width_s", width, "seconds")
    row_bytes = cols * bins * dtype.itemsize
    require(row_bytes <= MAX_ROW_BYTES, f"{field} row", f"{row_bytes} bytes", f"at most {MAX_ROW_BYTES}")
    at_once = max(CHUNK_BYTES // row_bytes, 1)

    def chunks() -> Iterator[Counts]:
        first = 0
        with read_errors(path, "a whole file of counts"):
            for part in read(at_once * (1 if len(shape) == 3 else cols)):
                counts = np.ascontiguousarray(part).reshape(-1, bins)
                possible = dtype.itemsize < 4 or bool((np.abs(counts) <= MAX_COUNT).all())      # NaN is not
                require(possible, "counts", f"beyond {MAX_COUNT} or not finite in places", "photons in a bin")
                yield Counts(first, counts, (first + len(counts)) / (rows * cols))
                first += len(counts)
    return Recording(rows, cols, bins, width_s, chunks, path.stem, notes, given, reference)


def parts_of(counts: np.ndarray) -> Callable[[int], Iterator[np.ndarray]]:
    """What gives an array that is in memory so many rows at a time."""
    return lambda rows: (counts[first:first + rows] for first in range(0, len(counts), rows))


def read(path: Path, options: dict) -> Recording:
    """An .npy file of counts."""
    counts = map_npy(path, f"{path.name} counts", MAX_CUBE_BYTES)
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, notes=few_bins_note(counts.shape))


def read_npz(path: Path, options: dict) -> Recording:
    """An array of counts in an .npz file; arrays named as in a photon file (irf, bin_width_s, …) are its sensor's."""
    with open_npz(path) as archive:
        name = the_cube(path, {name: shape for name, (shape, _, _) in npz_headers(archive).items()})
    arrays = read_npz_arrays(path, (name, *GIVEN))
    counts, given = arrays.pop(name), given_by(arrays)
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, few_bins_note(counts.shape))


def the_cube(path: Path, shapes: dict[str, tuple[int, ...]]) -> str:
    """Which of a file's arrays, given by their shapes, has the counts."""
    found = [name for name, shape in shapes.items() if len(shape) == 3] or \
        [name for name, shape in shapes.items() if len(shape) == 2 and name in NAMES]
    named = [name for name in found if name.rsplit("/", 1)[-1] in NAMES]
    listed = ", ".join(f"{name} {'×'.join(map(str, shape)) or 'one number'}" for name, shape in shapes.items())
    chosen = named if len(found) > 1 else found
    require(len(chosen) == 1, f"{path.name} arrays", listed or "none",
            f"one of three dimensions [rows, cols, bins], or of several one named {' or '.join(NAMES)}")
    return chosen[0]


def given_by(arrays: dict[str, np.ndarray]) -> dict:
    """The options that arrays of a file give, by name."""
    given = {}
    for name, value in arrays.items():
        value = np.asarray(value)
        require(name == "irf" or value.size == 1, f"{name} shape", value.shape, "one value")
        given[name] = irfs.read(value) if name == "irf" else value.reshape(-1)[0].item()
    return given
