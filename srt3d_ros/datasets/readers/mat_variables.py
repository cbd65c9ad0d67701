"""The variables of a .mat file that hold its photons; run as a module, a child process that writes them as an .npz.

A published file is recognised by the name and form of a variable: to read another one, add its `Layout`.
"""

import resource
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor import MAX_PIXELS
from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import MAX_PHOTONS
from srt3d_ros.datasets.readers.cubes import GIVEN
from srt3d_ros.errors import InvalidInput, require

EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
CELLS, COUNTS, SPARSE = "[rows, cols] cell", "[T, rows·cols] counts", "sparse [rows·cols, T] counts"
CUBE = "any other numeric array [rows, cols, bins]"


class Layout(NamedTuple):
    """How one published kind of file holds its photons.

    Args:
        variable: name of the array of photons.
        bin_width_s: where the file does not say; what the authors say, or inferred from their description.
        form: CELLS of ToA lists, COUNTS of photons per bin or SPARSE ones; pixels of counts in MATLAB's column-major
            order.
        picoseconds: ToA are times in picoseconds, not bins.
        window: scalars that hold the first and last ToA of the measured window.
        reference: array [rows, cols] of reference depths, numbered from 1 as MATLAB does.
    """

    variable: str
    bin_width_s: float
    form: str = CELLS
    picoseconds: bool = False
    window: tuple[str, ...] = ()
    reference: str = ""

    def fits(self, photons: object) -> bool:
        """Whether this is what scipy reads the variable of such a file as."""
        if self.form == SPARSE:
            return hasattr(photons, "tocoo")
        kinds = "O" if self.form == CELLS else "iuf"
        return isinstance(photons, np.ndarray) and photons.ndim == 2 and photons.dtype.kind in kinds


LAYOUTS = (
    Layout("Y", 16e-12, COUNTS, reference="DepthImage"),        # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                              # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                                        # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    Layout("data_processed", 100e-12, picoseconds=True,         # USTC, tower at 9.8 km (Li et al., Optica 2021);
           window=("mm", "MM")),                                # the bin width is our choice
    Layout("spad", 80e-12, SPARSE, reference="bin"),            # simulated: Lindell et al., SIGGRAPH 2018
)


def main(path: str, memory_bytes: str) -> None:
    """Write to stdout, as an .npz, what `variables_of` finds in so much memory; `refused` if the file is refused."""
    _bound_memory(int(memory_bytes))
    try:
        with naming_file(Path(path), EXPECTED):
            found = variables_of(path)
    except InvalidInput as error:
        _, texts = error.__reduce__()
        found = {"refused": np.array(texts)}
    np.savez(sys.stdout.buffer, **found)


def _bound_memory(extra: int) -> None:
    """Let this process take so many bytes more than it has, unless it has a limit; and leave no core file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    if resource.getrlimit(resource.RLIMIT_AS)[1] == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_AS, (used + extra, used + extra))


def variables_of(path: str) -> dict[str, np.ndarray]:
    """The variables of the layout that fits, and `layout`, its index, or -1 if none does.

    Of cells their content, one after the other, with `pixel` and `size`, [rows, cols]. Of counts their `size`, pixels
    and bins; of sparse ones pixel and bin of each photon. Without a layout `counts` [rows, cols, bins], and what
    describes the sensor.

    Raises:
        InvalidInput: nothing fits, or the photons are too many or no numbers.
    """
    from scipy.io import loadmat

    warnings.simplefilter("ignore")
    names = {name for one in LAYOUTS for name in (one.variable, *one.window, one.reference) if name}
    content = loadmat(path, variable_names=names)
    index = next((k for k, one in enumerate(LAYOUTS) if one.fits(content.get(one.variable))), -1)
    if index < 0:
        return _other_counts(path) | {"layout": np.array(index)}
    layout = LAYOUTS[index]
    photons = content[layout.variable]
    own = {CELLS: _of_cells, SPARSE: _of_sparse, COUNTS: _of_counts}[layout.form](layout.variable, photons)
    for name in filter(content.__contains__, (*layout.window, layout.reference)):
        own[name] = np.asarray(content[name])
        require(own[name].dtype.kind in "iuf", name, str(own[name].dtype), "numbers")
        require(own[name].size == 1 or name not in layout.window, f"{name} shape", own[name].shape, "one number")
    return own | {"layout": np.array(index)}


def _of_counts(name: str, counts: np.ndarray) -> dict[str, np.ndarray]:
    _check_whole(name, counts)
    return {name: counts, "size": np.array(counts.shape[::-1])}


def _of_sparse(name: str, counts) -> dict[str, np.ndarray]:
    require(counts.shape[0] <= MAX_PIXELS, f"{name} pixels", counts.shape[0], f"at most {MAX_PIXELS}")
    found = counts.tocoo()
    photons = found.data.astype(np.float64)
    _check_whole(name, photons)
    _check_number(name, photons.sum())
    photons = photons.astype(np.int64)
    return {name: found.col.repeat(photons), "pixel": found.row.repeat(photons), "size": np.array(counts.shape)}


def _check_whole(name: str, photons: np.ndarray) -> None:
    require(bool(((photons >= 0) & (photons == np.floor(photons))).all()), name, "negative or fractional in places",
            "photons per bin")


def _of_cells(name: str, cells: np.ndarray) -> dict[str, np.ndarray]:
    require(0 < cells.size <= MAX_PIXELS, f"{name} shape", cells.shape, f"1 to {MAX_PIXELS} pixels")
    lengths = np.fromiter((cell.size for cell in cells.flat), np.int64, cells.size)
    _check_number(name, lengths.sum())
    for cell in cells.flat:
        fits = isinstance(cell, np.ndarray) and (cell.dtype.kind in "iuf" or not cell.size)
        require(fits, f"{name} cells", f"{type(cell).__name__} of {getattr(cell, 'dtype', '')}", "lists of numbers")
    toa = np.concatenate([np.zeros(0, np.int64), *(cell.ravel() for cell in cells.flat if cell.size)])
    return {name: toa, "pixel": np.arange(cells.size).repeat(lengths), "size": np.array(cells.shape)}


def _check_number(name: str, photons: float) -> None:
    require(photons <= MAX_PHOTONS, f"{name} photons", photons, f"at most {MAX_PHOTONS}")


def _other_counts(path: str) -> dict[str, np.ndarray]:
    """The only numeric array of three dimensions of a file, and what describes its sensor by the names of options."""
    from scipy.io import loadmat, whosmat

    try:
        listed = whosmat(path)
    except TypeError:       # at objects of classes, which loadmat leaves out
        listed = []
    cubes = [name for name, shape, kind in listed if len(shape) == 3 and kind not in ("cell", "struct")]
    words = ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in listed)
    forms = "; ".join([*(f"{one.variable} ({one.form})" for one in LAYOUTS), CUBE])
    require(len(cubes) == 1, "variables", words if listed else "others, some of them objects", f"one of {forms}")
    content = loadmat(path, variable_names=[*cubes, *GIVEN])
    found = {"counts": content[cubes[0]]} | {name: content[name] for name in GIVEN if name in content}
    for name, values in found.items():
        require(isinstance(values, np.ndarray) and values.dtype.kind in "iufbU", name, type(values).__name__, "numbers")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
