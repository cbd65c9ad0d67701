"""Arrays of counts [rows, cols, bins], in .npy and .npz files, and in those of other readers."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.core.sketching.photons import PhotonHistograms
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.arrays import MAX_KEPT, are_whole, sampled
from srt3d_ros.datasets.files import map_npy, npz_headers, open_npz, read_errors, read_npz_arrays
from srt3d_ros.datasets.options import (
    ASSUMED_FOV,
    ASSUMED_WIDTH,
    BIN_OF_ONE_METRE_S,
    described,
    few_bins_note,
    outside_note,
    replaced_note,
    says_geometry,
)
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.values import number, sendable
from srt3d_ros.errors import require

MAX_CUBE_BYTES = 2**46
MAX_COUNT = 2**31 - 1
NAMES = ("counts", "cube", "histograms", "data")        # of the array that is meant, if there are several
GIVEN = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "toa_reference", "fov_deg")


def cube(path: Path, counts: np.ndarray, options: dict, given: dict | None = None, notes: tuple[str, ...] = (),
         reference: np.ndarray | None = None) -> Photons:
    """The photons that an array of counts holds: events if they are few, else histograms, which may stay in the file.

    Args:
        counts: [rows, cols, bins], or [pixels, bins], whose rows and cols `options` tell; else all are in one row.
        given: what the file says of its sensor, by the names of options.
        reference: depths that the file has, float32 [rows, cols], numbers of its bins.
    """
    field = f"{path.name} counts"
    require(counts.dtype.kind in "iufb" and counts.ndim in (2, 3) and counts.size > 0, field,
            f"{counts.dtype} {counts.shape}", "numbers [rows, cols, bins] or [pixels, bins]")
    given, (*own, bins) = given or {}, counts.shape
    own = own if len(own) == 2 else (1, *own)
    rows, cols = (int(number(name, options.get(name, size), "an integer")) for name, size in zip(("rows", "cols"), own))
    require(rows * cols == own[0] * own[1] and (counts.ndim == 2 or rows == own[0]), "rows, cols", f"{rows}, {cols}",
            f"those of the file's array, {' × '.join(map(str, counts.shape[:-1]))}")
    require(bins <= MAX_BINS or "gate" in options, f"{field} bins", bins, f"at most {MAX_BINS}; or give a gate")
    width_s = number("bin_width_s", (given | options).get("bin_width_s", BIN_OF_ONE_METRE_S), "seconds")
    notes += (ASSUMED_WIDTH,) * ("bin_width_s" not in given | options) + replaced_note(given, options)
    options = given | options
    bins = int(number("num_bins", options.get("num_bins", bins), "a number of bins"))
    first, last = options.get("gate", (0, bins - 1))
    require(1 <= last - first < MAX_BINS, "num_bins", last - first + 1,
            f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
    sensor = SensorModel(rows, cols, last - first + 1, width_s, np.ones(1))
    with read_errors(path, "a whole file of counts"):
        low, high = counts.min(), counts.max()      # a NaN makes both NaN
        require(bool(-MAX_COUNT <= low and high <= MAX_COUNT), "counts", f"beyond {MAX_COUNT} or not finite in places",
                "photons in a bin")
        total = counts.sum(dtype=np.float64)
        counts = sendable(counts.reshape(rows, cols, -1)[..., first:last + 1])
        missing = sensor.num_bins - counts.shape[2]
        counts = np.ascontiguousarray(np.pad(counts, ((0, 0), (0, 0), (0, missing))) if missing else counts)
        photons = counts.sum(dtype=np.float64)
        is_kept = photons <= MAX_KEPT and are_whole(counts)
        frame = sampled(counts) if is_kept else PhotonHistograms(counts)
    if "irf" not in options:
        sample = frame if is_kept else sampled(counts)
        options["irf"], note = irfs.estimated(sample, sensor.num_bins, options.get("guess_irf", False))
        notes += (note,)
    notes += () if says_geometry(options) else (ASSUMED_FOV,)
    sensor = described(sensor, {name: value for name, value in options.items() if name != "num_bins"})
    sensor = sensor.replace(toa_offset_bins=sensor.toa_offset_bins + first)
    notes += outside_note(round(total - photons), round(total), first, last)
    if reference is not None:
        depth = reference - np.float32(first)
        depth = np.where((depth >= 0) & (depth < sensor.num_bins), depth, np.float32(np.nan))
        reference = depth[None] + np.float32(sensor.first_bin_center)
    return Photons(sensor, frame, reference, path.stem, notes)


def read(path: Path, options: dict) -> Photons:
    """An .npy file of counts."""
    counts = map_npy(path, f"{path.name} counts", MAX_CUBE_BYTES)
    return cube(path, counts, options, notes=few_bins_note(counts.shape))


def read_npz(path: Path, options: dict) -> Photons:
    """An array of counts in an .npz file; arrays named as in a photon file (irf, bin_width_s, …) are its sensor's."""
    with open_npz(path) as archive:
        name = the_cube(path, {name: shape for name, (shape, _, _) in npz_headers(archive).items()})
    arrays = read_npz_arrays(path, (name, *GIVEN))
    counts, given = arrays.pop(name), given_by(arrays)
    return cube(path, counts, options, given, few_bins_note(counts.shape))


def the_cube(path: Path, shapes: dict[str, tuple[int, ...]]) -> str:
    """Which of a file's arrays, given by their shapes, has the counts."""
    found = [name for name, shape in shapes.items() if len(shape) == 3] or \
        [name for name, shape in shapes.items() if len(shape) == 2 and name in NAMES]
    named = [name for name in found if name in NAMES]
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
