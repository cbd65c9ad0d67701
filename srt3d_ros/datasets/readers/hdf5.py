"""Read HDF5 files with h5py: Photon-HDF5, one entry a photon, or an array of counts.

Photon-HDF5 (photon-hdf5.org) has a group `photon_data` with ToA `nanotimes` in bins of `nanotimes_specs/tcspc_unit`
seconds; they may be in no group, too. All are one pixel, or a detector is one.
"""

from pathlib import Path

import numpy as np

from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers import npz
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.values import channel_of
from srt3d_ros.errors import finite, require
from srt3d_ros.files import isolated
from srt3d_ros.files.array_files import read_errors

TOA, DETECTORS, UNIT, NUM_BINS, LASER = NAMES = (
    "nanotimes", "detectors", "nanotimes_specs/tcspc_unit", "nanotimes_specs/tcspc_num_bins",
    "measurement_specs/laser_repetition_rate")
GROUP = "photon_data/"
WANTED = f"Photon-HDF5 with {GROUP}{TOA}, {npz.WANTED}"


def read(path: Path, options: Options) -> Reading:
    """Photons of an HDF5 file; `channel` is the detector to take of Photon-HDF5, else all. Needs h5py."""
    names = (*NAMES, *(GROUP + name for name in NAMES), *npz.KNOWN, *options.named)
    return photons(path, *isolated.arrays_of(path, "h5py", names, "a complete HDF5 file"), options)


def photons(path: Path, content: dict[str, np.ndarray], listed: str, options: Options) -> Reading:
    """Photons of arrays by their names in an HDF5 file; `listed` says what it has, for an error."""
    with read_errors(path):
        content |= {name.removeprefix(GROUP): array for name, array in content.items()}
        if TOA in content and not options.named:
            content |= _photon_arrays(content, options)
            options = options.without("channel")
    return npz.from_arrays(path, content, options, WANTED, listed)


def _photon_arrays(content: dict[str, np.ndarray], options: Options) -> dict[str, np.ndarray]:
    """The arrays of a photon file (docs/photon-file.md) that Photon-HDF5 has by other names."""
    toa, pixels = content[TOA], options.known.get("rows", 1) * options.known.get("cols", 1)
    require(toa.ndim == 1 and toa.dtype.kind in "iu", TOA, f"{toa.dtype} {toa.shape}", "whole numbers [photons]")
    pixel = np.zeros(len(toa), np.uint32)
    if options.channel is not None or pixels > 1:
        pixel = content.get(DETECTORS, pixel[:0])
        require(pixel.shape == toa.shape, DETECTORS, problem=f"There is no {DETECTORS} with a number for each photon: "
                "leave out channel, rows and cols.")
    if options.channel is not None:
        require(pixels == 1, "channel", options.channel, "none beside rows and cols: detectors are then the pixels")
        toa = toa[pixel == channel_of(dict.fromkeys(np.unique(pixel).tolist(), 0), options.channel)[0]]
        pixel = np.zeros(len(toa), np.uint32)
    arrays = {"pixel": pixel, "toa": toa} | ({} if pixels > 1 else {"rows": np.array(1), "cols": np.array(1)})
    width_s, bins, laser_hz = (_number(content, name) for name in (UNIT, NUM_BINS, LASER))
    if width_s:
        arrays["bin_width_s"] = np.array(width_s)
    if bins:        # up to the end of the laser's period; a period that ends inside a bin includes it
        period = np.ceil(1 / (laser_hz * width_s) - 1e-3) if laser_hz and width_s else bins
        arrays["num_bins"] = np.array(int(min(bins, period)))
    return arrays


def _number(content: dict[str, np.ndarray], name: str) -> float:
    """One number above 0, or 0 if the file has none."""
    value = content.get(name, np.zeros(1))
    require(value.size == 1, name, value.shape, "one number")
    return max(finite(name, value.reshape(-1)[0]), 0.0)
