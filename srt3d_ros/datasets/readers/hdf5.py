"""HDF5 files, read with h5py: photon-HDF5, arrays of counts, and MATLAB's since 7.3, whose arrays are turned round."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.options import few_bins_note
from srt3d_ros.datasets.readers.cubes import GIVEN, cube, given_by, the_cube
from srt3d_ros.datasets.recording import Events, Recording
from srt3d_ros.datasets.values import positive_integer
from srt3d_ros.errors import require

EXPECTED = "a whole HDF5 file of counts [rows, cols, bins], or a photon-HDF5 file"
PHOTONS = 2**20             # read at once
MAX_DATASETS = 10_000
MAX_SPOTS = 2**12           # groups photon_data0, photon_data1, …
MATLAB_BYTES = b"MATLAB 7.3 MAT-file"


def is_matlab(path: Path) -> bool:
    """Whether it is a .mat file of MATLAB 7.3 or later."""
    with path.open("rb") as file:
        return file.read(len(MATLAB_BYTES)) == MATLAB_BYTES


def read(path: Path, options: dict) -> Recording:
    """The photons or counts of an HDF5 file.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: h5py is not installed.
    """
    import h5py

    with naming_file(path, EXPECTED), h5py.File(path, "r") as file:
        if any(name.startswith("photon_data") for name in file):
            return _photons(path, file, options)
        return _cube(path, file, options)


def _datasets(file) -> dict:
    """All datasets by their path."""
    import h5py

    found = {}

    def look(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None:
            found[name] = item
            require(len(found) <= MAX_DATASETS, "datasets", f"more than {MAX_DATASETS}", "fewer")
    file.visititems(look)
    return found


def _cube(path: Path, file, options: dict) -> Recording:
    datasets = {name: one for name, one in _datasets(file).items() if one.dtype.kind in "iufb"}
    name = the_cube(path, {name: one.shape for name, one in datasets.items()})
    turned = is_matlab(path)            # MATLAB writes the last index first
    shape, dtype = datasets[name].shape[::-1] if turned else datasets[name].shape, datasets[name].dtype
    known = {key: datasets[key][()] for key in GIVEN if key in datasets and datasets[key].size < 2**24}
    known |= {key: file.attrs[key] for key in GIVEN if key in file.attrs}

    def read(rows: int) -> Iterator[np.ndarray]:
        import h5py

        with h5py.File(path, "r") as file:
            counts = file[name]
            for first in range(0, shape[0], rows):
                part = np.s_[first:first + rows]
                yield np.ascontiguousarray(counts[..., part].T) if turned else counts[part]
    return cube(path, shape, dtype, read, options, given_by(known), few_bins_note(shape))


def _photons(path: Path, file, options: dict) -> Recording:
    """Photon-HDF5 (Ingargiola et al., Biophys. J. 110, 2016): each spot's each detector is a pixel of a row."""
    spots = [name for name in ("photon_data", *(f"photon_data{k}" for k in range(MAX_SPOTS))) if name in file]
    groups = [file[name] for name in spots]
    for name, group in zip(spots, groups):
        require("nanotimes" in group, f"{name}/nanotimes", "missing", "times of photons since the laser's pulse")
        times, own = group["nanotimes"].shape, group.get("detectors", group["nanotimes"]).shape
        require(len(times) == 1 and own == times, f"{name}/detectors shape", own, f"one entry a photon, {times}")
    specs = groups[0]["nanotimes_specs"]
    bins, width_s = int(specs["tcspc_num_bins"][()]), float(specs["tcspc_unit"][()])
    detectors = [_detectors(group) for group in groups]
    if "channel" in options:
        wanted = positive_integer("channel", options["channel"] + 1) - 1
        detectors = [own[own == wanted] for own in detectors]
    pixels = sum(len(own) for own in detectors)
    require(pixels > 0, "detectors", "none", "one with photons")
    rows, cols = (positive_integer(name, options.get(name, own)) for name, own in (("rows", 1), ("cols", pixels)))
    require(rows * cols == pixels, "rows, cols", f"{rows}, {cols}", f"a product of {pixels}, the number of detectors")
    total = sum(len(group["nanotimes"]) for group in groups)

    def chunks() -> Iterator[Events]:
        import h5py

        done, first_pixel = 0, 0
        with naming_file(path, EXPECTED), h5py.File(path, "r") as file:
            for name, own in zip(spots, detectors):
                group = file[name]
                for first in range(0, len(group["nanotimes"]), PHOTONS):
                    part = np.s_[first:first + PHOTONS]
                    toa = group["nanotimes"][part].astype(np.int64)
                    of = group["detectors"][part] if "detectors" in group else np.zeros(len(toa), np.int64)
                    at = np.minimum(np.searchsorted(own, of), len(own) - 1)
                    done += len(toa)
                    yield Events(np.where(own[at] == of, first_pixel + at, -1), toa, done / max(total, 1))
                first_pixel += len(own)
    notes = (f"{pixels} detectors in the place of pixels, {rows} × {cols}: the file says nothing of a scan",)
    return Recording(rows, cols, bins, width_s, chunks, path.stem, notes)


def _detectors(group) -> np.ndarray:
    """The numbers of a spot's detectors that have photons, in order."""
    if "detectors" not in group:
        return np.zeros(1, np.int64)
    seen, values = np.zeros(0, np.int64), group["detectors"]
    for first in range(0, len(values), PHOTONS):
        seen = np.union1d(seen, values[first:first + PHOTONS])
    return seen.astype(np.int64)
