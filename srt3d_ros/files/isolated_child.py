"""The process in which SciPy, h5py or sdtfile reads an untrusted file. Imports nothing of srt3d_ros."""

import importlib
import resource
import sys
import warnings
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

ARRAY = "array/"        # begins the names of arrays in what the child writes
MOST_LISTED = 100       # arrays; an error shows fewer
CPU_S = 600             # 3 GB unpack in a tenth of it
# MATLAB says in these attributes of HDF5 what an array was. It stores axes in reverse, and cells in groups that begin
# with "#".
CLASS, EMPTY, SPARSE = "MATLAB_class", "MATLAB_empty", "MATLAB_sparse"
Found = tuple[dict[str, np.ndarray], list[tuple[str, tuple, str]]]      # arrays; name, shape, kind of all


def main(library: str, path: str, most: str, *names: str) -> None:
    """Write the arrays that the library's reader finds to stdout as .npz, with `said`: an error's class, its text, the
    list of all arrays.

    Memory is limited to `most` bytes more than the process has once the library is imported.
    """
    warnings.simplefilter("ignore")
    module, read = READERS[library]
    importlib.import_module(module)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    for limit, value in ((resource.RLIMIT_CPU, CPU_S), (resource.RLIMIT_AS, used + int(most))):
        with suppress(ValueError):      # a lower limit is set already
            resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))
    arrays, listed, error = {}, [], ("", "")
    try:
        arrays, listed = read(path, names)
    except MemoryError:
        error = "MemoryError", ""
    except Exception as raised:
        error = type(raised).__name__, str(raised)
    np.savez(sys.stdout.buffer, said=(*error, listing(listed[:MOST_LISTED])),
             **{ARRAY + name: array for name, array in arrays.items()})


def listing(entries: list[tuple[str, tuple, str]]) -> str:
    """Name, shape and type of each array of a file, for an error."""
    return ", ".join(f"{name} ({' '.join(filter(None, ('×'.join(map(str, shape)), kind)))})"
                     for name, shape, kind in entries) or "no arrays"


def matlab_5(path: str, names: tuple[str, ...]) -> Found:
    """The arrays of these names of a MATLAB 5 file, and the only array of three dimensions.

    Cells become NAME, their contents one after the other, and NAME.lengths [rows, cols]. Sparse arrays become NAME, the
    numbers that are not 0, with NAME.row, NAME.col and NAME.shape.
    """
    from scipy.io import loadmat, whosmat

    try:
        shapes = whosmat(path)      # reads no values
    except TypeError:               # on objects of classes, which loadmat leaves out
        content = loadmat(path)
        shapes = [(name, one.shape, str(one.dtype)) for name, one in content.items() if hasattr(one, "dtype")]
    else:
        cubes = [name for name, shape, kind in shapes if len(shape) == 3 and kind not in ("cell", "struct")]
        content = loadmat(path, variable_names=[*names, *(cubes if len(cubes) == 1 else ())])
    arrays = {}
    for name, value in content.items():
        if hasattr(value, "tocoo"):
            arrays |= _sparse(name, value)
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
            arrays |= _cells(name, [cell.ravel() for cell in value.flat], value.shape)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufbU":
            arrays[name] = value
    return arrays, shapes


def hdf5(path: str, names: tuple[str, ...]) -> Found:
    """As `matlab_5`, of HDF5 and MATLAB 7.3: an array in a group is GROUP/NAME. `names` may be patterns of fnmatch."""
    import h5py

    with h5py.File(path) as file:
        nodes, arrays = {}, {}

        def visit(name: str, node: h5py.HLObject) -> None:
            inside = name.startswith("#") or name.rpartition("/")[0] in nodes       # of a cell or a sparse array
            if not inside and (SPARSE in node.attrs or getattr(node, "shape", None) is not None):
                nodes[name] = node

        file.visititems(visit)
        shapes = {name: _shape(node) for name, node in nodes.items()}
        cubes = [name for name, shape in shapes.items() if len(shape) == 3 and _is_numeric(nodes[name])]
        for name, node in nodes.items():
            if cubes != [name] and not any(name == pattern or fnmatchcase(name, pattern) for pattern in names):
                continue
            if SPARSE in node.attrs:
                arrays |= _matlab_sparse(name, node)
            elif node.attrs.get(CLASS) == b"cell":
                cells = [file[reference] for reference in node[()].T.flat]
                arrays |= _cells(name, [np.zeros(0) if EMPTY in cell.attrs else cell[()].ravel() for cell in cells],
                                node.shape[::-1])
            elif _is_numeric(node):
                if node.external or node.is_virtual:
                    raise ValueError(f"{name} keeps its numbers in another file")
                arrays[name] = node[()].T if CLASS in node.attrs else np.asarray(node[()])
        return arrays, [(name, shape, _kind(nodes[name])) for name, shape in shapes.items()]


def sdt(path: str, names: tuple[str, ...]) -> Found:
    """Each data set of counts [rows, cols, bins] of an .sdt file as K, from 0, and K.width, seconds of a bin or 0.

    A block of several detectors has as many data sets. Curves [curves, bins] are a row of pixels. `names` is not used.
    """
    import sdtfile

    arrays, shapes = {}, []
    with sdtfile.SdtFile(path) as file:
        for counts, times in zip(file.data, file.times, strict=True):
            if not counts.size or counts.dtype.kind not in "iu":
                continue
            for part in counts.reshape(-1, *(1, 1, *counts.shape)[-3:]):
                name = str(len(shapes))
                arrays |= {name: part, f"{name}.width": np.array(times[1] - times[0] if len(times) > 1 else 0.0)}
                shapes.append((name, part.shape, str(part.dtype)))
    return arrays, shapes


READERS = {"scipy": ("scipy.io", matlab_5), "h5py": ("h5py", hdf5), "sdtfile": ("sdtfile", sdt)}    # by library


def _cells(name: str, lists: list[np.ndarray], shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    inside = np.concatenate([np.zeros(0, np.int64), *(values for values in lists if values.size)])
    return {name: inside[:0] if inside.dtype.kind == "O" else inside,
            f"{name}.lengths": np.array([values.size for values in lists]).reshape(shape)}


def _sparse(name: str, array) -> dict[str, np.ndarray]:
    sparse = array.tocoo()
    return {name: sparse.data, f"{name}.row": sparse.row, f"{name}.col": sparse.col,
            f"{name}.shape": np.array(sparse.shape)}


def _matlab_sparse(name: str, group) -> dict[str, np.ndarray]:
    from scipy.sparse import csc_array

    numbers, rows, ends = (group[part][()] for part in ("data", "ir", "jc"))
    sparse = csc_array((numbers, rows.astype(np.int64), ends.astype(np.int64)), _shape(group))
    sparse.check_format()
    return _sparse(name, sparse)


def _shape(node) -> tuple[int, ...]:
    """The shape of an array of HDF5 as the program that wrote it says it."""
    if SPARSE in node.attrs:
        return int(node.attrs[SPARSE]), len(node["jc"]) - 1
    return node.shape[::-1] if CLASS in node.attrs else node.shape


def _kind(node) -> str:
    named = node.attrs.get(CLASS)
    return named.decode() if isinstance(named, bytes) else str(getattr(node, "dtype", "group"))


def _is_numeric(node) -> bool:
    return (SPARSE not in node.attrs and node.dtype.kind in "iufb" and EMPTY not in node.attrs
            and node.attrs.get(CLASS) != b"char")


if __name__ == "__main__":
    main(*sys.argv[1:])
