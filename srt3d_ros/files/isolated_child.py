"""The process in which SciPy or h5py reads an untrusted file. Imports nothing of srt3d_ros."""

import importlib
import resource
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

ARRAY = "array/"        # begins the names of arrays in what the child writes
MOST_LISTED = 100       # arrays; an error shows fewer
CPU_S = 600             # 3 GB unpack in a tenth of it
# MATLAB 7.3 says in these attributes of HDF5 what an array was. It stores axes in reverse, what is in cells in groups
# that begin with "#".
# PyTables keeps its indices in groups that begin with "_i_".
CLASS, EMPTY = "MATLAB_class", "MATLAB_empty"
NO_NUMBERS = "cell", "struct", "char", "object", "function", "opaque"      # kinds of MATLAB's arrays, and of NumPy's
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
    saved: dict[str, Any] = {ARRAY + name: array for name, array in arrays.items()}
    np.savez(sys.stdout.buffer, said=(*error, listing(listed[:MOST_LISTED])), **saved)


def listing(entries: list[tuple[str, tuple, str]]) -> str:
    """Name, shape and type of each array of a file, for an error."""
    return ", ".join(f"{name} ({' '.join(filter(None, ('×'.join(map(str, shape)), kind)))})"
                     for name, shape, kind in entries) or "no arrays"


def may_be_counts(shape: tuple, kind: str) -> bool:
    """Whether an array may hold counts: numbers with three or four axes, but no picture (bytes of 3 or 4 colours)."""
    return len(shape) in (3, 4) and kind not in NO_NUMBERS and not (kind == "uint8" and shape[-1] in (3, 4))


def matlab_5(path: str, names: tuple[str, ...]) -> Found:
    """The arrays of these names of a MATLAB 5 file, and the only array that may hold counts.

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
        cubes = [name for name, shape, kind in shapes if may_be_counts(shape, kind)]
        content = loadmat(path, variable_names=[*names, *(cubes if len(cubes) == 1 else ())])
    arrays = {}
    for name, value in content.items():
        if hasattr(value, "tocoo"):
            sparse = value.tocoo()
            arrays |= {name: sparse.data, f"{name}.row": sparse.row, f"{name}.col": sparse.col,
                       f"{name}.shape": np.array(sparse.shape)}
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
            lists = [cell.ravel() for cell in value.flat]
            inside = np.concatenate([np.zeros(0, np.int64), *(values for values in lists if values.size)])
            arrays |= {name: inside[:0] if inside.dtype.kind == "O" else inside,
                       f"{name}.lengths": np.array([values.size for values in lists]).reshape(value.shape)}
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufbU":
            arrays[name] = value
    return arrays, shapes


def hdf5(path: str, names: tuple[str, ...]) -> Found:
    """As `matlab_5`, of HDF5 and MATLAB 7.3: an array in a group is GROUP/NAME.

    NAME.dims are the names of its dimensions, if they have any, as xarray writes them.
    """
    import h5py

    with suppress(ImportError):
        importlib.import_module("hdf5plugin")       # registers filters
    with h5py.File(path) as file:
        nodes, arrays, listed, numeric = {}, {}, [], {}

        def visit(name: str, node: Any) -> None:
            if not name.startswith("#") and "_i_" not in name and getattr(node, "shape", None) is not None:
                nodes[name] = node

        file.visititems(visit)
        for group, node in nodes.items():
            matlab = node.attrs.get(CLASS, b"").decode()
            for column in node.dtype.names or ("",):
                name, dtype = (f"{group}/{column}", node.dtype[column]) if column else (group, node.dtype)
                listed.append((name, node.shape[::-1] if matlab else node.shape, matlab or str(dtype)))
                if dtype.kind in "iufb" and EMPTY not in node.attrs and matlab != "char":
                    numeric[name] = node, column
        cubes = [name for name, shape, kind in listed if name in numeric and may_be_counts(shape, kind)]
        for name, (node, column) in numeric.items():
            if cubes == [name] or name in names:
                content = _content(name, node, column or ())
                arrays[name] = content.T if CLASS in node.attrs else content
                dims = [Path(dim[0].name).name if len(dim) else dim.label for dim in node.dims]
                arrays |= {f"{name}.dims": np.array(dims)} if any(dims) else {}
        return arrays, listed


def _content(name: str, node: Any, part: str | tuple) -> np.ndarray:
    """A data set or a column of one."""
    import h5py

    if node.external or node.is_virtual:
        raise ValueError(f"{name} keeps its numbers in another file")
    created = node.id.get_create_plist()
    filters = [created.get_filter(index)[0] for index in range(created.get_nfilters())]
    if not all(map(h5py.h5z.filter_avail, filters)):
        raise ValueError(f"pip install hdf5plugin to unpack {name}")
    return np.asarray(node[part])


READERS = {"scipy": ("scipy.io", matlab_5), "h5py": ("h5py", hdf5)}    # by library


if __name__ == "__main__":
    main(*sys.argv[1:])
