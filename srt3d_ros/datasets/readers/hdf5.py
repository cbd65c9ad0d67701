"""Arrays of counts in HDF5 files, read with h5py; also MATLAB's since 7.3, whose arrays are turned round."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import read_errors
from srt3d_ros.datasets.options import few_bins_note
from srt3d_ros.datasets.readers.cubes import GIVEN, cube, given_by, the_cube
from srt3d_ros.datasets.recording import Recording
from srt3d_ros.errors import require

EXPECTED = "a whole HDF5 file of counts [rows, cols, bins]"
MAX_DATASETS = 10_000
MAX_GIVEN = 2**24           # numbers of an IRF
MATLAB_BYTES = b"MATLAB 7.3 MAT-file"


def is_matlab(path: Path) -> bool:
    """Whether it is a .mat file of MATLAB 7.3 or later."""
    with path.open("rb") as file:
        return file.read(len(MATLAB_BYTES)) == MATLAB_BYTES


def read(path: Path, options: dict) -> Recording:
    """The counts of an HDF5 file; datasets and attributes named as in a photon file are its sensor's.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: h5py is not installed.
    """
    import h5py

    with read_errors(path, EXPECTED), h5py.File(path, "r") as file:
        datasets = _datasets(file)
        name = the_cube(path, {name: one.shape for name, one in datasets.items()})
        turned = is_matlab(path)            # MATLAB writes the last index first
        shape, dtype = datasets[name].shape[::-1] if turned else datasets[name].shape, datasets[name].dtype
        known = {key: datasets[key][()] for key in GIVEN if key in datasets and datasets[key].size < MAX_GIVEN}
        known |= {key: file.attrs[key] for key in GIVEN if key in file.attrs}

    def rows_of(rows: int) -> Iterator[np.ndarray]:
        with h5py.File(path, "r") as file:
            counts = file[name]
            for first in range(0, shape[0], rows):
                part = np.s_[first:first + rows]
                yield np.ascontiguousarray(counts[..., part].T) if turned else counts[part]
    return cube(path, shape, dtype, rows_of, options, given_by(known), few_bins_note(shape))


def _datasets(file) -> dict:
    """All datasets of numbers by their path."""
    import h5py

    found = {}

    def look(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None and item.dtype.kind in "iufb":
            found[name] = item
            require(len(found) <= MAX_DATASETS, "datasets", f"more than {MAX_DATASETS}", "fewer")
    file.visititems(look)
    return found
