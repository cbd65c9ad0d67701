"""How numba compiles the kernels, and where it keeps the machine code."""

import hashlib
import logging
import os
import shutil
from pathlib import Path

from numba import __version__, config, njit
from numba.core import event

# OpenMP lets several threads of one process (those of somebody's own program, say) call kernels at once; numba's own
# work queue would abort. An explicit choice in the environment wins.
if "NUMBA_THREADING_LAYER" not in os.environ:
    config.THREADING_LAYER = "omp"
KEPT = 6            # newest folders that stay: those of a few checkouts and of the version before


def _folder() -> Path | None:
    """Where machine code is kept: NUMBA_CACHE_DIR or ~/.cache/srt3d_ros; None if it cannot be written.

    It is named after all that goes into a kernel. Numba looks at the file of the function alone, and would run
    yesterday's code after a change of a constant or an inlined function elsewhere.
    """
    own, digest = Path(__file__).parent, hashlib.sha256(__version__.encode())
    for file in (*sorted(own.parent.glob("*.py")), *sorted(own.glob("*.py"))):
        digest.update(file.read_bytes())
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        parent = Path(config.CACHE_DIR or caches / "srt3d_ros")
        (folder := parent / f"srt3d-kernels-{digest.hexdigest()[:16]}").mkdir(parents=True, exist_ok=True)
        folder.touch()
        newest_first = sorted(parent.glob("srt3d-kernels-*"), key=lambda path: -path.stat().st_mtime)
    except (OSError, RuntimeError):         # RuntimeError: this user has no home
        return None
    for old in newest_first[KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    return folder if os.access(folder, os.W_OK) else None


def _kept(**options):
    """A decorator: compile at first use, and keep the machine code in FOLDER."""
    def decorate(function):
        theirs, config.CACHE_DIR = config.CACHE_DIR, str(FOLDER)    # read once a function: other programs keep theirs
        try:
            return njit(cache=FOLDER is not None, error_model="numpy", **options)(function)
        finally:
            config.CACHE_DIR = theirs
    return decorate


class _Watch(event.Listener):
    """Says once that kernels are being compiled, not read from the disk."""

    said = False

    def on_start(self, event) -> None:
        if not self.said and (event.data["dispatcher"].__module__ or "").startswith(f"{__package__}."):
            self.said = True
            again = "once; `srt3d compile` does it beforehand" if FOLDER else "at every start: set NUMBA_CACHE_DIR"
            logging.getLogger(__name__).info(f"compiling kernels, for seconds up to a minute ({again})")

    def on_end(self, event) -> None:
        """Nothing is said."""


FOLDER = _folder()
event.register("numba:compile", _Watch())

# No fastmath, which would be 5 % faster: the last bit would depend on what the compiler makes of a kernel, and that
# differs between one just compiled and the same one from the cache.
parallel = _kept(parallel=True, nogil=True)
serial = _kept(nogil=True)                              # for so little work that waking threads would cost more
line = njit(error_model="numpy")                        # called for a line of pixels or cells
inline = njit(forceinline=True, error_model="numpy")    # by LLVM: numba's own inlining compiles a fifth longer
