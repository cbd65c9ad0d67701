"""How numba compiles the kernels, and when it does so anew."""

import hashlib
import os
from pathlib import Path

import numba
from numba import njit

# OpenMP lets several threads of one process (two nodes on one executor, say) call kernels at once; numba's own
# work queue would abort. An explicit choice in the environment wins.
if "NUMBA_THREADING_LAYER" not in os.environ:
    numba.config.THREADING_LAYER = "omp"


def _sources() -> str:
    """A digest of all that goes into a kernel: numba inlines functions and constants of other files."""
    own = Path(__file__).parent
    files = [*sorted(own.parent.glob("*.py")), *sorted(own.glob("*.py"))]
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


SOURCES = _sources()


def _kept(**options):
    """A decorator: compile at first use, and keep the machine code on disk until a source changes.

    Numba's own cache would look at the file of the function alone, and run yesterday's kernel after a change elsewhere.
    """
    def decorate(function):
        kernel = njit(cache=True, error_model="numpy", **options)(function)
        kernel._cache._cache_file._source_stamp = SOURCES
        return kernel

    return decorate


# No fastmath, which would be 5 % faster: the last bit would depend on what the compiler makes of a kernel, and that
# differs between one just compiled and the same one from the cache.
parallel = _kept(parallel=True, nogil=True)
serial = _kept()
line = njit(error_model="numpy")                            # called for a line of pixels or cells
inline = njit(inline="always", error_model="numpy")
