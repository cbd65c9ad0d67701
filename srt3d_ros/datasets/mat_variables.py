"""What a .mat file holds, as scipy reads it: for a child process, since its reader trusts the file."""

import warnings
from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor import MAX_PIXELS
from srt3d_ros.datasets.cubes import GIVEN
from srt3d_ros.datasets.photons import MAX_PHOTONS
from srt3d_ros.errors import require

EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"


@dataclass(frozen=True)
class Layout:
    """How one published kind of file holds its photons.

    Args:
        variable: name of the array of photons: a cell array [rows, cols] of ToA lists, or with `counts` a numeric
            array [T, rows · cols] of photons per bin with pixels in MATLAB's column-major order.
        bin_width_s: where the file does not say; what the authors say, or inferred from their description.
        counts: see `variable`.
        sparse: with `counts`, the array is sparse [rows · cols, T].
        picoseconds: ToA are times in picoseconds, not bins.
        window: scalars that hold the first and last ToA of the measured window.
        reference: array [rows, cols] of reference depths, numbered from 1 as MATLAB does.
    """

    variable: str
    bin_width_s: float
    counts: bool = False
    sparse: bool = False
    picoseconds: bool = False
    window: tuple[str, ...] = ()
    reference: str = ""

    @property
    def form(self) -> str:
        """What the variable looks like, in words."""
        if self.sparse:
            return f"{self.variable} (sparse [rows·cols, T] counts)"
        return f"{self.variable} ({'[T, rows·cols] counts' if self.counts else '[rows, cols] cell'})"

    @property
    def variables(self) -> tuple[str, ...]:
        """All that are read."""
        return tuple(filter(None, (self.variable, *self.window, self.reference)))

    def fits(self, photons: object) -> bool:
        """Whether scipy may read this kind of file's variable as this."""
        if self.sparse:
            return hasattr(photons, "tocoo")
        kinds = "iuf" if self.counts else "O"
        return isinstance(photons, np.ndarray) and photons.ndim == 2 and photons.dtype.kind in kinds


LAYOUTS = (
    Layout("Y", 16e-12, counts=True, reference="DepthImage"),   # Heriot-Watt polystyrene head
    Layout("photon_times", 8e-12),                              # MIT, two layers (Shin et al., Opt. Express 2016)
    Layout("Ts", 8e-12),                                        # MIT, mannequin face (Shin et al., IEEE TCI 2015)
    Layout("data_processed", 100e-12, picoseconds=True,         # USTC, tower at 9.8 km (Li et al., Optica 2021);
           window=("mm", "MM")),                                # the bin width is our choice
    Layout("spad", 80e-12, counts=True, sparse=True, reference="bin"),      # simulated: Lindell et al., SIGGRAPH 2018
)
CUBE = "any other numeric array [rows, cols, bins]"


def variables_of(path: str) -> dict[str, np.ndarray]:
    """The variables that a layout names; `layout`, its index; of cells the content, and their `lengths` [rows, cols].

    Of sparse counts [3, N]: pixel, bin, photons; and their `size`. Without a layout (-1) `counts` [rows, cols, bins],
    and what describes the sensor.

    Raises:
        InvalidInput: no layout fits, or the cells are too many or hold no numbers.
    """
    from scipy.io import loadmat

    warnings.simplefilter("ignore")
    names = {name for layout in LAYOUTS for name in layout.variables}
    content = {name: value for name, value in loadmat(path, variable_names=names).items() if name in names}
    layout = next((one for one in LAYOUTS if one.fits(content.get(one.variable))), None)
    if layout is None:
        return _other_counts(path) | {"layout": np.array(-1)}
    variables = {name: content[name] for name in layout.variables if name in content}
    if layout.sparse:
        sparse = variables[layout.variable].tocoo()
        variables[layout.variable] = np.stack([sparse.row, sparse.col, sparse.data.astype(np.float64)])
        variables["size"] = np.array([sparse.shape])
    elif not layout.counts:
        variables[layout.variable], variables["lengths"] = _joined(layout, variables[layout.variable])
    for name, values in variables.items():
        require(isinstance(values, np.ndarray) and values.dtype.kind in "iuf", name, type(values).__name__, "numbers")
        require(values.ndim == 2 or not layout.counts, f"{name} shape", values.shape, "[rows, columns]")
        require(values.size == 1 or name not in layout.window, f"{name} shape", values.shape, "one number")
    return variables | {"layout": np.array(LAYOUTS.index(layout))}


def _joined(layout: Layout, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is in the cells, one after the other in row order, and how many values are in each."""
    require(0 < cells.size <= MAX_PIXELS, f"{layout.variable} shape", cells.shape, f"1 to {MAX_PIXELS} pixels")
    lengths = np.fromiter((cell.size for cell in cells.flat), np.int64, cells.size).reshape(cells.shape)
    photons = int(lengths.sum())
    require(photons <= MAX_PHOTONS, f"{layout.variable} photons", photons, f"at most {MAX_PHOTONS}")
    seen = [cell for cell in cells.flat if cell.size]
    odd = next((cell for cell in seen if not isinstance(cell, np.ndarray) or cell.dtype.kind not in "iuf"), None)
    require(odd is None, f"{layout.variable} cells", f"{type(odd).__name__} of {getattr(odd, 'dtype', '')}",
            "lists of numbers")
    toa = np.concatenate([cell.ravel() for cell in seen]) if seen else np.zeros(0, np.int64)
    return toa, lengths


def _other_counts(path: str) -> dict[str, np.ndarray]:
    """The only numeric array of three dimensions of a file, and what describes its sensor by the names of options."""
    from scipy.io import loadmat, whosmat

    try:
        cubes = [name for name, shape, kind in whosmat(path) if len(shape) == 3 and kind not in ("cell", "struct")]
    except TypeError:       # at objects of classes
        cubes = []
    forms = "; ".join([*(one.form for one in LAYOUTS), CUBE])
    require(len(cubes) == 1, "variables", _listed(path), f"one of {forms}")
    content = loadmat(path, variable_names=[*cubes, *GIVEN])
    found = {"counts": content[cubes[0]]} | {name: content[name] for name in GIVEN if name in content}
    for name, values in found.items():
        require(isinstance(values, np.ndarray) and values.dtype.kind in "iufbU", name, type(values).__name__, "numbers")
    return found


def _listed(path: str) -> str:
    """Which variables a file has."""
    from scipy.io import whosmat

    try:
        return ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in whosmat(path))
    except TypeError:       # at objects of classes, which loadmat leaves out
        return "others, some of them objects"
