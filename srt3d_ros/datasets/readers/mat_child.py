"""The variables of a .mat file, read by SciPy in a child process: some damaged files end the process."""

import os
import resource
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import read_errors
from srt3d_ros.datasets.readers.cubes import GIVEN
from srt3d_ros.datasets.readers.mat_layouts import EXPECTED, LAYOUTS
from srt3d_ros.errors import InvalidInput
from srt3d_ros.processes import ending


def load(path: Path) -> dict[str, np.ndarray]:
    """`variables` of a file, from a child process with the same modules as this one; InvalidInput if it fails."""
    command = [sys.executable, "-P", "-m", __name__, str(path)]
    modules = {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}
    with tempfile.TemporaryFile() as file, read_errors(path, EXPECTED):
        done = subprocess.run(command, env=os.environ | modules, stdin=subprocess.DEVNULL, stdout=file,
                              stderr=subprocess.PIPE, text=True)
        if done.returncode != 0:
            why = f"its reader {ending(done)}" if done.returncode < 0 else done.stderr.strip().rpartition("\n")[2]
            raise InvalidInput("", f"unreadable ({why})", EXPECTED)
        file.seek(0)
        with np.load(file) as arrays:
            return dict(arrays)


def main(path: str) -> None:
    """In the child: write the variables to stdout, as an .npz, without a core file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    np.savez(sys.stdout.buffer, **variables(path))


def variables(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays that LAYOUTS names; of a file without photons, those of three dimensions and of a sensor.

    Of cells what is in them, one after the other, and NAME.lengths [rows, cols]; sparse arrays in full, transposed.
    `listed` says in words what else there is.
    """
    from scipy.io import loadmat, whosmat

    content = loadmat(path, variable_names={name for one in LAYOUTS for name in one.names})
    found = {}
    if not any(one.variable in content for one in LAYOUTS):
        try:
            listed = whosmat(path)
        except TypeError:       # at objects of classes, which loadmat leaves out
            listed = []
        words = ", ".join(f"{name} ({'×'.join(map(str, shape))} {kind})" for name, shape, kind in listed)
        found["listed"] = np.array(words or "others, some of them objects")
        cubes = [name for name, shape, kind in listed if len(shape) == 3 and kind not in ("cell", "struct")]
        content = loadmat(path, variable_names=[*cubes, *GIVEN])
    for name, value in content.items():
        if hasattr(value, "toarray"):
            found[name] = value.T.toarray()
        elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
            lengths = np.fromiter((cell.size for cell in value.flat), np.int64, value.size)
            filled = [cell.ravel() for cell in value.flat if cell.size]
            found |= {name: np.concatenate([np.zeros(0, np.int64), *filled]),
                      f"{name}.lengths": lengths.reshape(value.shape)}
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufbU":
            found[name] = value
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
