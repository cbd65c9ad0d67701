"""Arrays of counts [rows, cols, bins], in .npy and .npz files, and in those of other readers."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.arrays import MAX_KEPT, are_whole, complete, sampled, sensor_of
from srt3d_ros.datasets.options import check_same, few_bins_note, outside_note, replaced_note
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.values import sendable
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import map_npy, read_errors, read_npz_arrays

MAX_CUBE_BYTES = 2**46
MAX_COUNT = 2**31 - 1
GIVEN = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "cycles", "fov_deg")


def cube(path: Path, counts: np.ndarray, options: dict, given: dict | None = None, notes: tuple[str, ...] = (),
         reference: np.ndarray | None = None) -> Photons:
    """The photons that an array of counts holds: events if they are few, else histograms, which may stay in the file.

    Args:
        counts: [rows, cols, bins].
        given: what the file says of its sensor, by the names of options.
        reference: depths that the file has, float32 [rows, cols], numbers of its bins.
    """
    field, given = f"{path.name} counts", given or {}
    require(counts.dtype.kind in "iufb" and counts.ndim == 3 and counts.size > 0, field,
            f"{counts.dtype} {counts.shape}", "numbers [rows, cols, bins]")
    rows, cols, bins = counts.shape
    check_same({"rows": rows, "cols": cols}, options)
    require(bins <= MAX_BINS or "gate" in options, f"{field} bins", bins, f"at most {MAX_BINS}; or give a gate")
    replaced, options = replaced_note(given, options), given | options
    bins = int(finite("num_bins", options.get("num_bins", bins), "a number of bins"))
    first, last = options.get("gate", (0, bins - 1))
    require(1 <= last - first < MAX_BINS, "num_bins", last - first + 1,
            f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
    sensor, width_note = sensor_of(options | {"rows": rows, "cols": cols, "num_bins": last - first + 1})
    with read_errors(path, "a whole file of counts"):
        low, high = counts.min(), counts.max()      # a NaN makes both NaN
        require(bool(-MAX_COUNT <= low and high <= MAX_COUNT), "counts", f"beyond {MAX_COUNT} or not finite in places",
                "photons in a bin")
        total = counts.sum(dtype=np.float64)
        counts = sendable(counts[..., first:last + 1])
        missing = sensor.num_bins - counts.shape[2]
        counts = np.ascontiguousarray(np.pad(counts, ((0, 0), (0, 0), (0, missing))) if missing else counts)
        photons = counts.sum(dtype=np.float64)
        frame = sampled(counts) if photons <= MAX_KEPT and are_whole(counts) else PhotonHistograms(counts)
    sensor, _, notes = complete(frame, sensor, options, notes + width_note + replaced)
    sensor = sensor.replace(toa_offset_bins=sensor.toa_offset_bins + first)
    notes += outside_note(round(total - photons), round(total), first, last)
    return Photons(sensor, frame, in_gate(reference, first, sensor.num_bins), path.stem, notes)


def in_gate(depth: np.ndarray | None, first: int, bins: int) -> np.ndarray | None:
    """Reference depths [1, rows, cols], if there are any, from the first bin of a gate; those outside are unknown."""
    if depth is None:
        return None
    depth = depth - np.float32(first)
    return np.where((depth >= 0) & (depth < bins), depth, np.float32(np.nan))[None]


def the_cube(path: Path, arrays: dict[str, np.ndarray], options: dict, field: str = "arrays",
             wanted: str = "one of numbers [rows, cols, bins]", listed: str = "") -> Photons:
    """The photons of the only array of three dimensions; others describe its sensor by the names of options."""
    cubes = [values for values in arrays.values() if values.ndim == 3 and values.dtype.kind in "iufb"]
    there = ", ".join(f"{name} ({'×'.join(map(str, one.shape))} {one.dtype})" for name, one in arrays.items())
    require(len(cubes) == 1, field, listed or there or "none", wanted)
    given = {}
    for name in filter(arrays.__contains__, GIVEN):
        value = arrays[name]
        require(name == "irf" or value.size == 1, f"{name} shape", value.shape, "one value")
        given[name] = irfs.read(value) if name == "irf" else value.reshape(-1)[0].item()
    return cube(path, cubes[0], options, given, few_bins_note(cubes[0].shape))


def read(path: Path, options: dict) -> Photons:
    """An .npy file of counts."""
    counts = map_npy(path, f"{path.name} counts", MAX_CUBE_BYTES)
    return cube(path, counts, options, notes=few_bins_note(counts.shape))


def read_npz(path: Path, options: dict) -> Photons:
    """An array of counts in an .npz file; arrays named as in a photon file (irf, bin_width_s, …) are its sensor's."""
    arrays = read_npz_arrays(path, GIVEN, and_cubes=True)
    with read_errors(path):
        return the_cube(path, arrays, options)
