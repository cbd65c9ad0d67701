"""The process in which another module reads an untrusted file. Imports nothing of srt3d_ros."""

import json
import resource
import runpy
import sys
import warnings
from pathlib import Path

import numpy as np

ALIGNMENT = 64          # bytes, of each array in the file that the caller maps
MOST_LISTED = 100       # arrays; an error shows fewer
CPU_S = 600             # 3 GB unpack in a tenth of it


def main(reader: str, path: str, file: str, most: str, *names: str) -> None:
    """Write the arrays of the reader's `variables` to the open file descriptor `file`, and their places to stdout.

    Memory is limited to `most` bytes more than the process has once the reader is imported.
    """
    warnings.simplefilter("ignore")
    variables = runpy.run_path(reader)["variables"]
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
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
    json.dump({"arrays": places, "listed": listed[:MOST_LISTED]}, sys.stdout)


if __name__ == "__main__":
    main(*sys.argv[1:])
