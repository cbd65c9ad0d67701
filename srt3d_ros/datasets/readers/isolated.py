"""Read a file with SciPy, h5py or sdtfile in a process of its own: a damaged file may end it or fill its memory."""

import builtins
import json
import os
import re
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.values import listing
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, READER_ERRORS, read_errors
from srt3d_ros.processes.children import ending

CHILD = Path(__file__).with_name("isolated_child.py")
MATLAB_7_3, HDF5 = b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n"        # beginnings of files


def arrays_of(path: Path, library: str, names: tuple[str, ...], expected: str) -> tuple[dict[str, np.ndarray], str]:
    """Arrays of a file, as the library's function of isolated_child.py finds them; mapped from a temporary file.

    Args:
        names: the wanted arrays, as patterns of fnmatch. The only array of three dimensions is read, too.
        expected: what the file should be, in words.

    Returns:
        The arrays by name, and a text that lists all arrays of the file.

    Raises:
        InvalidInput: the file is unreadable, or has more than MAX_ARRAY_BYTES in these arrays.
        ModuleNotFoundError: the library is not installed.
    """
    if find_spec(library) is None:
        raise ModuleNotFoundError(f"No module named '{library}'", name=library)
    modules = os.pathsep.join(map(os.path.abspath, sys.path))
    with read_errors(path, expected), tempfile.TemporaryFile() as file:
        # -P keeps this folder's modules from shadowing others. The caller's module path gives the child the same SciPy.
        done = subprocess.run([sys.executable, "-P", CHILD, library, path, str(file.fileno()), str(MAX_ARRAY_BYTES),
                               *names],
                              stdin=subprocess.DEVNULL, capture_output=True, pass_fds=(file.fileno(),),
                              env=os.environ | {"PYTHONPATH": modules, "OPENBLAS_NUM_THREADS": "1"})
        message = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        message = re.sub(r"^(\w+\.)+", "", message)           # the module of the error's class
        require("MemoryError" not in message, "", problem=f"The arrays take more than {MAX_ARRAY_BYTES} bytes. Save "
                "counts as uint8 or uint16, or as .npy, which may be larger than memory.")
        kind = getattr(builtins, message.partition(":")[0], None)
        if isinstance(kind, type) and issubclass(kind, READER_ERRORS):
            message = "its reader failed"
        elif done.returncode < 0:
            message = f"its reader {ending(done)}"
        require(done.returncode == 0, "", f"unreadable ({message})", expected)
        content = json.loads(done.stdout)
        arrays = {name: np.zeros(shape, kind) if 0 in shape else
                  np.memmap(file, kind, "c", place, tuple(shape), order)
                  for name, kind, place, shape, order in content["arrays"]}
    return arrays, listing(content["listed"])


def matlab_arrays(path: Path, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
    """`arrays_of` a .mat file with SciPy, or with h5py if the file is HDF5: MATLAB 7.3."""
    with path.open("rb") as file:
        begin = file.read(len(MATLAB_7_3))
    library = "h5py" if begin.startswith((MATLAB_7_3, HDF5)) else "scipy"
    return arrays_of(path, library, names, "a complete MATLAB .mat file")
