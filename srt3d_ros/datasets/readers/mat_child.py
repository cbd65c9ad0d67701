"""Read a MATLAB 5 .mat file with SciPy, for isolated_child.py. Imports nothing of srt3d_ros."""

import numpy as np
from scipy.io import loadmat, whosmat


def variables(path: str, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], list[tuple[str, tuple, str]]]:
    """The arrays of these names, and the only array of three dimensions; and name, shape and kind of all arrays.

    Cells become NAME, their contents one after the other, and NAME.lengths [rows, cols]. Sparse arrays become NAME, the
    numbers that are not 0, with NAME.row, NAME.col and NAME.shape.
    """
    try:
        shapes = whosmat(path)      # reads no values
    except TypeError:               # on objects of classes, which loadmat leaves out
        content = loadmat(path)
        shapes = [(name, one.shape, str(one.dtype)) for name, one in content.items() if hasattr(one, "dtype")]
    else:
        cubes = [name for name, shape, kind in shapes if len(shape) == 3 and kind not in ("cell", "struct")]
        content = loadmat(path, variable_names=[*names, *(cubes if len(cubes) == 1 else ())])
    found = {}
    for name, value in content.items():
        if hasattr(value, "tocoo"):
            sparse = value.tocoo()
            found |= {name: sparse.data, f"{name}.row": sparse.row, f"{name}.col": sparse.col,
                      f"{name}.shape": np.array(sparse.shape)}
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
            inside = np.concatenate([np.zeros(0, np.int64), *(cell.ravel() for cell in value.flat if cell.size)])
            found[name] = inside[:0] if inside.dtype.kind == "O" else inside
            found[f"{name}.lengths"] = np.array([cell.size for cell in value.flat]).reshape(value.shape)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufbU":
            found[name] = value
    return found, shapes
