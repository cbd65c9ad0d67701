"""Read an HDF5 file, or a MATLAB 7.3 .mat file, with h5py, for isolated_child.py. Imports nothing of srt3d_ros."""

from fnmatch import fnmatchcase

import h5py
import numpy as np

# MATLAB says in these attributes what an array was. It stores axes in reverse, and cells in groups that begin with "#".
CLASS, EMPTY, SPARSE = "MATLAB_class", "MATLAB_empty", "MATLAB_sparse"


def variables(path: str, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], list[tuple[str, tuple, str]]]:
    """As `variables` of mat_child.py; an array in a group is called GROUP/NAME. Names may be patterns of fnmatch."""
    found = {}
    with _opened(path) as file:
        nodes = _nodes(file)
        shapes = {name: _shape(node) for name, node in nodes.items()}
        cubes = [name for name, shape in shapes.items() if len(shape) == 3 and _is_numeric(nodes[name])]
        for name, node in nodes.items():
            if cubes != [name] and not any(name == pattern or fnmatchcase(name, pattern) for pattern in names):
                continue
            if isinstance(node, h5py.Group):
                found |= _sparse(name, node)
            elif node.attrs.get(CLASS) == b"cell":
                found |= _cells(name, node, file)
            elif _is_numeric(node):
                if node.external or node.is_virtual:
                    raise ValueError(f"{name} keeps its numbers in another file")
                found[name] = node[()].T if CLASS in node.attrs else np.asarray(node[()])
        return found, [(name, shape, _kind(nodes[name])) for name, shape in shapes.items()]


def _opened(path: str) -> h5py.File:
    try:
        return h5py.File(path, "r")
    except OSError as error:        # "Unable to synchronously open file (truncated file: eof = …)"
        raise OSError(str(error).rpartition("(")[2].partition(":")[0].rstrip(")")) from None


def _nodes(file: h5py.File) -> dict[str, h5py.Dataset | h5py.Group]:
    """Arrays by name; of MATLAB's sparse arrays the group."""
    nodes = {}

    def visit(name: str, node: h5py.HLObject) -> None:
        if name.startswith("#") or name.rpartition("/")[0] in nodes:
            return
        if SPARSE in node.attrs or isinstance(node, h5py.Dataset) and node.shape is not None:
            nodes[name] = node

    file.visititems(visit)
    return nodes


def _shape(node: h5py.Dataset | h5py.Group) -> tuple[int, ...]:
    """The shape as the program that wrote it says it."""
    if SPARSE in node.attrs:
        return int(node.attrs[SPARSE]), len(node["jc"]) - 1
    return node.shape[::-1] if CLASS in node.attrs else node.shape


def _kind(node: h5py.Dataset | h5py.Group) -> str:
    named = node.attrs.get(CLASS)
    return named.decode() if isinstance(named, bytes) else str(getattr(node, "dtype", "group"))


def _is_numeric(node: h5py.Dataset | h5py.Group) -> bool:
    return (isinstance(node, h5py.Dataset) and node.dtype.kind in "iufb" and EMPTY not in node.attrs
            and node.attrs.get(CLASS) != b"char")


def _cells(name: str, references: h5py.Dataset, file: h5py.File) -> dict[str, np.ndarray]:
    """Contents and lengths of a cell array."""
    cells = [file[reference] for reference in references[()].T.flat]
    lists = [np.zeros(0, np.int64) if EMPTY in cell.attrs else cell[()].ravel() for cell in cells]
    inside = np.concatenate([np.zeros(0, np.int64), *(values for values in lists if values.size)])
    return {name: inside[:0] if inside.dtype.kind == "O" else inside,
            f"{name}.lengths": np.array([values.size for values in lists]).reshape(references.shape[::-1])}


def _sparse(name: str, group: h5py.Group) -> dict[str, np.ndarray]:
    """Numbers, rows, columns and shape of a sparse array."""
    from scipy.sparse import csc_array

    numbers, rows, ends = (group[part][()] for part in ("data", "ir", "jc"))
    sparse = csc_array((numbers, rows.astype(np.int64), ends.astype(np.int64)), _shape(group))
    sparse.check_format()
    sparse = sparse.tocoo()
    return {name: sparse.data, f"{name}.row": sparse.row, f"{name}.col": sparse.col,
            f"{name}.shape": np.array(sparse.shape)}
