"""Read a .mat file with SciPy in a process of its own, which a damaged file may kill. Imports nothing of srt3d_ros."""

import json
import resource
import sys
import warnings
from pathlib import Path

import numpy as np
from scipy.io import loadmat, whosmat

ALIGNMENT = 64      # bytes, of each array in the file that the caller maps


def main(path: str, file: str, most: str, *names: str) -> None:
    """Write the arrays of `variables` to the open file descriptor `file`, and where they lie to stdout as JSON.

    Memory is limited to `most` bytes more than the process has.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + int(most)
    resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    (arrays, listed), places = variables(path, names), []
    with open(int(file), "wb") as stream:
        for name, array in arrays.items():
            stream.write(bytes(-stream.tell() % ALIGNMENT))
            order = "F" if array.flags.f_contiguous else "C"
            places.append((name, array.dtype.str, stream.tell(), array.shape, order))
            if array.size:
                stream.write(array.ravel("K").view(np.uint8))
    json.dump({"arrays": places, "listed": listed}, sys.stdout)


def variables(path: str | Path, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
    """The arrays of these names, and the only array of three dimensions; and a text that lists all arrays.

    Cells become NAME, their contents one after the other, and NAME.lengths [rows, cols]. Sparse arrays become NAME, the
    numbers that are not 0, with NAME.row, NAME.col and NAME.shape.
    """
    warnings.simplefilter("ignore")
    try:
        shapes = whosmat(path)      # reads no values
    except TypeError:               # on objects of classes, which loadmat leaves out
        content = loadmat(path)
        shapes = [(name, one.shape, one.dtype) for name, one in content.items() if hasattr(one, "dtype")]
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
    return found, ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in shapes)


if __name__ == "__main__":
    main(*sys.argv[1:])
