"""Read a file with SciPy or h5py in a process of its own: a damaged file may end it or fill its memory."""

import builtins
import os
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from subprocess import DEVNULL

import numpy as np

from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, read_errors
from srt3d_ros.files.isolated_child import ARRAY

CHILD = Path(__file__).with_name("isolated_child.py")
MATLAB_7_3, HDF5 = b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n"        # beginnings of files


def arrays_of(path: Path, library: str, names: tuple[str, ...], expected: str) -> tuple[dict[str, np.ndarray], str]:
    """Arrays of a file by name, as the library's function of isolated_child.py finds them, and a text that lists all.

    Args:
        names: the wanted arrays. The only array that may hold counts is read, too.
        expected: what the file should be, in words.

    Raises:
        InvalidInput: the file is unreadable, or has more than MAX_ARRAY_BYTES in these arrays.
        ModuleNotFoundError: the library is not installed.
    """
    if find_spec(library) is None:
        raise ModuleNotFoundError(f"No module named '{library}'", name=library)
    # -P keeps this folder's modules from shadowing others. The caller's module path gives the child the same SciPy.
    command = [sys.executable, "-P", CHILD, library, path, str(MAX_ARRAY_BYTES), *names]
    environment = {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    with read_errors(path, expected), tempfile.TemporaryFile() as file:
        done = subprocess.run(command, stdin=DEVNULL, stdout=file, stderr=DEVNULL, env=os.environ | environment)
        code = done.returncode
        ending = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        require(code == 0, "", f"unreadable (its reader {ending})", expected)
        file.seek(0)
        with np.load(file) as content:
            kind, text, listed = content["said"].tolist()
            require(kind != "MemoryError", "", problem=f"The arrays take more than {MAX_ARRAY_BYTES} bytes. Save "
                    "counts as uint8 or uint16, or as .npy, which may be larger than memory.")
            if kind:
                raise getattr(builtins, kind, ValueError)(text)
            return {name.removeprefix(ARRAY): content[name] for name in content if name != "said"}, listed


def matlab_arrays(path: Path, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
    """`arrays_of` a .mat file with SciPy, or with h5py if the file is HDF5: MATLAB 7.3."""
    with path.open("rb") as file:
        begin = file.read(len(MATLAB_7_3))
    library = "h5py" if begin.startswith((MATLAB_7_3, HDF5)) else "scipy"
    return arrays_of(path, library, names, "a complete MATLAB .mat file")
