"""Read HDF5 files with h5py: Photon-HDF5, one entry a photon, or an array of counts.

Photon-HDF5 (photon-hdf5.org) has a group `photon_data`, or `photon_data0` … for several spots, with ToA `nanotimes` in
bins of `nanotimes_specs/tcspc_unit` seconds; what is in no group is a single spot, too. A spot is a pixel; of a single
spot with rows and cols, a detector is one.
"""

import re
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers import npz
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.values import channel_of
from srt3d_ros.errors import finite, require
from srt3d_ros.files import isolated
from srt3d_ros.files.array_files import read_errors

UNIT, NUM_BINS, LASER = "nanotimes_specs/tcspc_unit", "nanotimes_specs/tcspc_num_bins", \
    "measurement_specs/laser_repetition_rate"
SPOT_ARRAYS = tuple(group + name for group in ("photon_data*/", "")
                    for name in ("nanotimes", "detectors", UNIT, NUM_BINS, LASER))
WANTED = f"Photon-HDF5 with photon_data/nanotimes, {npz.WANTED}"


def read(path: Path, options: Options) -> Reading:
    """Photons of an HDF5 file; `channel` is the detector to take of Photon-HDF5, else all. Needs h5py."""
    names = (*SPOT_ARRAYS, *npz.KNOWN, *options.named)
    return photons(path, *isolated.arrays_of(path, "h5py", names, "a complete HDF5 file"), options)


def photons(path: Path, content: dict[str, np.ndarray], listed: str, options: Options) -> Reading:
    """Photons of arrays by their names in an HDF5 file; `listed` says what it has, for an error."""
    with read_errors(path):
        spots = sorted((int(match[2] or 0), match[1]) for match in
                       map(re.compile(r"(photon_data(\d{0,9})/)nanotimes").fullmatch, content) if match)
        groups = [spot for _, spot in spots] or [""] * ("nanotimes" in content)
        if groups and not options.named:
            content |= _spot_arrays(content, groups, options)
            options = options.without("channel")
    return npz.from_arrays(path, content, options, WANTED, listed)


def _spot_arrays(content: dict[str, np.ndarray], spots: list[str], options: Options) -> dict[str, np.ndarray]:
    """The arrays of a photon file (docs/photon-file.md) that Photon-HDF5 has in its groups."""
    times = [_toa(content, spot, options) for spot in spots]
    pixels = options.known.get("rows", 1) * options.known.get("cols", 1)
    arrays = {"pixel": np.arange(len(spots)).repeat([len(toa) for toa in times]), "toa": np.concatenate(times)}
    if len(spots) == 1 and pixels > 1 and f"{spots[0]}detectors" in content and options.channel is None:
        arrays["pixel"] = content[f"{spots[0]}detectors"]
    elif not {"rows", "cols"} & options.known.keys():
        arrays |= {"rows": np.array(1), "cols": np.array(len(spots))}
    else:
        require(pixels == len(spots), "shape", (options.known.get("rows"), options.known.get("cols")),
                f"rows × cols = {len(spots)}, the spots of the file")
    width_s, bins, laser_hz = (_number(content, f"{spots[0]}{name}") for name in (UNIT, NUM_BINS, LASER))
    if width_s:
        arrays["bin_width_s"] = np.array(width_s)
    if bins:        # up to the end of the laser's period; a period that ends inside a bin includes it
        period = np.ceil(1 / (laser_hz * width_s) - 1e-3) if laser_hz and width_s else bins
        arrays["num_bins"] = np.array(int(min(bins, period)))
    return arrays


def _toa(content: dict[str, np.ndarray], spot: str, options: Options) -> np.ndarray:
    """ToA of a spot, of the detector `channel` if given."""
    toa, detectors = content[f"{spot}nanotimes"], content.get(f"{spot}detectors")
    require(toa.ndim == 1 and toa.dtype.kind in "iu", f"{spot}nanotimes", f"{toa.dtype} {toa.shape}",
            "whole numbers [photons]")
    if options.channel is None:
        return toa
    require(detectors is not None and detectors.shape == toa.shape, f"{spot}detectors",
            problem=f"There is no {spot}detectors with a number for each photon, from which to take a channel.")
    return toa[detectors == channel_of(dict.fromkeys(np.unique(detectors).tolist(), 0), options.channel)[0]]


def _number(content: dict[str, np.ndarray], name: str) -> float:
    """One number above 0, or 0 if the file has none."""
    value = content.get(name, np.zeros(1))
    require(value.size == 1, name, value.shape, "one number")
    return max(finite(name, value.reshape(-1)[0]), 0.0)
