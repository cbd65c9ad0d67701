"""Read HDF5 files with h5py: Photon-HDF5, one entry a photon, or an array of counts.

Photon-HDF5 (photon-hdf5.org) has a group `photon_data` with ToA `nanotimes` in bins of `nanotimes_specs/tcspc_unit`
seconds; they may be in no group, too. All are one pixel.
"""

from pathlib import Path
from typing import Any

import numpy as np

from srt3d_ros.datasets import named_arrays
from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.values import channel_of
from srt3d_ros.errors import finite, require
from srt3d_ros.files import isolated
from srt3d_ros.files.array_files import read_errors

TOA, DETECTORS, UNIT, NUM_BINS, LASER = NAMES = (
    "nanotimes", "detectors", "nanotimes_specs/tcspc_unit", "nanotimes_specs/tcspc_num_bins",
    "measurement_specs/laser_repetition_rate")
GROUP = "photon_data/"
WANTED = f"Photon-HDF5 with {GROUP}{TOA}, {named_arrays.WANTED}"


def read(path: Path, options: Options) -> Content:
    """Photons of an HDF5 file; `channel` is the detector to take of Photon-HDF5, else all. Needs h5py."""
    names = (*NAMES, *(GROUP + name for name in NAMES), *named_arrays.KNOWN, *options.named)
    arrays, listed = isolated.arrays_of(path, "h5py", names, "a complete HDF5 file")
    return photons(path, Content(arrays, options, (), listed, WANTED))


def photons(path: Path, content: Content) -> Content:
    """The content of an HDF5 file, with the arrays of a photon file in place of those of Photon-HDF5."""
    arrays, options = content.arrays, content.options
    arrays = arrays | {name.removeprefix(GROUP): array for name, array in arrays.items()}
    if TOA not in arrays or options.named:
        return content._replace(arrays=arrays)
    with read_errors(path):
        return content._replace(arrays=arrays | _photon_arrays(arrays, options), options=options.without("channel"))


def _photon_arrays(content: dict[str, np.ndarray], options: Options) -> dict[str, Any]:
    """The arrays of a photon file (docs/photon-file.md) that Photon-HDF5 has by other names."""
    toa, channel = content[TOA], options.channel
    require(toa.ndim == 1 and toa.dtype.kind in "iu", TOA, f"{toa.dtype} {toa.shape}", "whole numbers [photons]")
    require(options.known.get("rows", 1) * options.known.get("cols", 1) == 1, "rows × cols",
            problem=f"To make each detector a pixel, give columns={DETECTORS},{TOA} (--columns) and num_bins.")
    if channel is not None:
        detectors = content.get(DETECTORS, toa[:0])
        require(detectors.shape == toa.shape, DETECTORS,
                problem=f"There is no {DETECTORS} with a number for each photon: leave out channel.")
        toa = toa[detectors == channel_of(dict.fromkeys(np.unique(detectors).tolist(), 0), channel)[0]]
    arrays = {"pixel": np.zeros(len(toa), np.uint32), "toa": toa, "rows": 1, "cols": 1}
    width_s, bins, laser_hz = (_number(content, name) for name in (UNIT, NUM_BINS, LASER))
    if width_s:
        arrays["bin_width_s"] = width_s
    if bins:        # up to the end of the laser's period; a period that ends inside a bin includes it
        period = np.ceil(1 / (laser_hz * width_s) - 1e-3) if laser_hz and width_s else bins
        arrays["num_bins"] = int(min(bins, period))
    return arrays


def _number(content: dict[str, np.ndarray], name: str) -> float:
    """One number above 0, or 0 if the file has none."""
    value = content.get(name, np.zeros(1))
    require(value.size == 1, name, value.shape, "one number")
    return max(finite(name, value.reshape(-1)[0]), 0.0)
