"""Photons of counts [rows, cols, bins], for the readers of files."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.datasets.arrays import MAX_KEPT, are_whole, complete, sampled, sensor_of
from srt3d_ros.datasets.axes import SIZES, choose, in_order
from srt3d_ros.datasets.options import Options, check_same, replaced_note
from srt3d_ros.datasets.reading import Reading, in_gate
from srt3d_ros.datasets.sensor_arrays import sensor_options, values_of
from srt3d_ros.datasets.values import outside_note, sendable
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import read_errors

MAX_COUNT = 2**31 - 1
# Arrays beside the counts that describe the sensor.
BESIDE = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "cycles", "dead_time_s", "period_s",
          "fov_deg")


def cube(path: Path, counts: np.ndarray, options: Options, stated: dict | None = None, notes: tuple[str, ...] = (),
         reference: np.ndarray | None = None) -> Reading:
    """Photons of an array of counts: events if there are few, else histograms, which may stay in the file.

    Args:
        counts: [rows, cols, bins].
        stated: what the file says of its sensor, by the names of options.
        reference: depths in bins of the file, float32 [1, rows, cols].
    """
    stated, field = stated or {}, f"{path.name} counts"
    require(counts.dtype.kind in "iufb" and counts.ndim == 3 and counts.size > 0, field,
            f"{counts.dtype} {counts.shape}", "numbers [rows, cols, bins]")
    rows, cols, bins = counts.shape
    check_same({"rows": rows, "cols": cols}, options.known)
    require(bins <= MAX_BINS or options.gate is not None, f"{field} bins", bins, f"at most {MAX_BINS}; or give a gate")
    known = stated | options.known
    period = int(finite("num_bins", known.get("num_bins", bins), "a number of bins"))
    first, last = options.gate or (0, period - 1)
    num_bins = last - first + 1
    require(2 <= num_bins <= MAX_BINS, "num_bins", num_bins,
            f"2 to {MAX_BINS}: give num_bins, gate or bin_width_s")
    completed = replace(options, known=known | {"rows": rows, "cols": cols, "num_bins": num_bins})
    sensor, width_note = sensor_of(completed)
    with read_errors(path, "a whole file of counts"):
        low, high = counts.min().item(), counts.max().item()        # a NaN makes both NaN
        require(bool(-MAX_COUNT <= low and high <= MAX_COUNT), "counts",
                problem=f"counts holds values beyond {MAX_COUNT}, infinite or NaN.")
        photons = counts.sum(dtype=np.float64)
        frame, kept = _frame_of(counts[..., first:last + 1], num_bins)
    sensor, _, all_notes = complete(frame, sensor, completed,
                                    notes + width_note + replaced_note(stated, options.known))
    outside = outside_note(round(photons - kept), round(photons), first, last)
    return Reading(sensor.replace(toa_offset_bins=sensor.toa_offset_bins + first), frame,
                   in_gate(reference, first, last), path.stem, all_notes + outside)


def _frame_of(counts: np.ndarray, num_bins: int) -> tuple[PhotonEvents | PhotonHistograms, float]:
    """Counts as a frame of `num_bins` bins, the missing ones empty; and the number of photons."""
    kept = sendable(counts)
    missing = num_bins - kept.shape[2]
    if missing:
        kept = np.pad(kept, ((0, 0), (0, 0), (0, missing)))
    kept = np.ascontiguousarray(kept)
    photons = kept.sum(dtype=np.float64)
    few = photons <= MAX_KEPT and are_whole(kept)
    return sampled(kept) if few else PhotonHistograms(kept), photons


def only_cube(path: Path, arrays: dict[str, np.ndarray], options: Options, wanted: str, listed: str) -> Reading:
    """Photons of the array of counts; the sizes and those BESIDE it describe the sensor.

    An error says what is `wanted`, and what the file has: `listed`.
    """
    name, options = choose(arrays, options, wanted, listed)
    sizes = {size for size in SIZES if size in arrays and arrays[size].size == 1}       # others are coordinates
    stated = sensor_options(values_of({key: arrays[key] for key in (*BESIDE, *sizes) if key in arrays and key != name}))
    dims = tuple(map(str, arrays.get(f"{name}.dims", ())))
    counts, others, notes, frames = in_order(arrays[name], options, stated, dims)
    return replace(cube(path, counts, others, stated, notes), frames=frames)
