"""The child process in which SciPy reads a .mat file, since some damaged files end the process that reads them.

It runs this file as a script, and imports nothing of srt3d_ros: it starts in the time that SciPy takes.
"""

import json
import resource
import sys
import warnings
from pathlib import Path
from typing import BinaryIO

import numpy as np
from scipy.io import loadmat, whosmat

ALIGNMENT = 64      # bytes, of the arrays in the file that the caller maps


def main(path: str, file: str, most: str, *names: str) -> None:
    """Write `variables` to an open file, with no more than `most` bytes for them, and what is where to stdout."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = taken + int(most)
    resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    arrays, listed = variables(path, names)
    with open(int(file), "wb") as stream:
        places = [_write(stream, name, array) for name, array in arrays.items()]
    json.dump({"arrays": places, "listed": listed}, sys.stdout)


def variables(path: str | Path, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
    """The arrays of these names, and that of three dimensions if there is one; and all that there are, in words.

    Of cells, what is in them one after the other, and NAME.lengths [rows, cols]. Of sparse arrays, the numbers that are
    not 0, and NAME.row, NAME.col and NAME.shape.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            shapes = whosmat(path)      # before any values
        except TypeError:               # at objects of classes, which loadmat leaves out
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
            lengths = np.fromiter((cell.size for cell in value.flat), np.int64, value.size)
            filled = [cell.ravel() for cell in value.flat if cell.size]
            found |= {name: np.concatenate(filled or [np.zeros(0, np.int64)]),
                      f"{name}.lengths": lengths.reshape(value.shape)}
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufbU":
            found[name] = value
    return found, ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in shapes)


def _write(stream: BinaryIO, name: str, array: np.ndarray) -> tuple[str, str, int, tuple[int, ...], str]:
    """Append an array, and return its name, type, place, shape and order; of what has no bytes to show, none."""
    if array.dtype.kind == "O" or array.nbytes == 0:
        array = np.zeros(0, array.dtype) if array.size else array
        return name, array.dtype.str, 0, array.shape, "C"
    order = "F" if array.flags.f_contiguous else "C"
    stream.write(bytes(-stream.tell() % ALIGNMENT))
    place = stream.tell()
    stream.write(np.ascontiguousarray(array.T if order == "F" else array).reshape(-1).view(np.uint8))
    return name, array.dtype.str, place, array.shape, order


if __name__ == "__main__":
    main(*sys.argv[1:])
