"""How numba compiles the kernels, and when it does so anew."""

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numba
from numba import njit
from numba.core import event

# OpenMP lets several threads of one process (those of somebody's own program, say) call kernels at once; numba's own
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
LOG = logging.getLogger(__name__)
KERNELS: list = []          # all that are kept on disk
# Seconds of a core, an AMD EPYC's, to compile one: of phase_sums for every type of ToA, 12 s for 7; 39 s for 17.
SECONDS_SKETCH, SECONDS_OTHER = 1.7, 2.3
SKETCHING, BASELINES, RECONSTRUCTION = "sketching", "methods that are not the default", "reconstruction"
MOVING = "a sensor that moves"
PURPOSES = {"phase_sums": SKETCHING, "move_sketch": MOVING,      # by module
            **dict.fromkeys(("apss", "match", "gradients"), BASELINES)}
CANNOT_KEEP = "neither the package's folder nor ~/.cache can be written; set NUMBA_CACHE_DIR"


def _kept(**options):
    """A decorator: compile at first use, and keep the machine code on disk until a source changes.

    Numba's own cache would look at the file of the function alone, and run yesterday's kernel after a change elsewhere.
    """
    def decorate(function):
        try:
            kernel = njit(cache=True, error_model="numpy", **options)(function)
            kernel._cache._cache_file._source_stamp = SOURCES
        except RuntimeError:        # numba's, where neither the package's folder nor the user's cache can be written
            kernel = njit(error_model="numpy", **options)(function)
        KERNELS.append(kernel)
        return kernel

    return decorate


def folder() -> Path | None:
    """Where machine code is kept: beside the kernels if that can be written, else in the user's cache, else nowhere."""
    path = getattr(KERNELS[0]._cache, "cache_path", None)
    return path and Path(path)


def missing(also_baselines: bool = True) -> list:
    """The kernels without machine code for this processor on disk; others may lack it for some types of arguments."""
    return [kernel for kernel in KERNELS if (also_baselines or _purpose(kernel) != BASELINES) and not _has_code(kernel)]


def state_of(kernel) -> str:
    """What the machine code depends on: the sources, the compiler, and the processor that it is for."""
    kernel.targetctx.refresh()
    return f"{SOURCES} {numba.__version__} {sys.version_info[:2]} {kernel.targetctx.codegen().magic_tuple()}"


def name_of(kernel) -> str:
    """Such as `birth_death._update`."""
    return f"{_module(kernel)}.{kernel.__name__}"       # two modules may have kernels of one name


def on_compiled(tell: Callable[[object], None]) -> None:
    """Have tell(kernel) called whenever a kernel has been compiled, not read from the disk, in this process."""
    _WATCH.tell = tell


def _module(kernel) -> str:
    return kernel.__module__.rsplit(".", 1)[-1]


def _has_code(kernel) -> bool:
    if folder() is None:
        return False
    kernel.targetctx.refresh()
    wanted = kernel._cache._index_key(None, kernel.targetctx.codegen())[1:]
    return any(key[1:] == wanted for key in kernel._cache._cache_file._load_index())


class _Watch(event.Listener):
    """Says once for sketching, once for reconstruction and once for a baseline that kernels are being compiled."""

    def __init__(self):
        self.tell: Callable[[object], None] = lambda kernel: None
        self._said: set[str] = set()

    def on_start(self, event) -> None:
        kernel = event.data["dispatcher"]
        if kernel in KERNELS and (what := _purpose(kernel)) not in self._said:
            self._said.add(what)
            several = [other for other in missing() if _purpose(other) == what] or [kernel]
            seconds = len(several) * (SECONDS_SKETCH if what == SKETCHING else SECONDS_OTHER)
            again = "once; `srt3d compile` does it beforehand" if folder() else f"at every start: {CANNOT_KEEP}"
            LOG.info(f"compiling {len(several)} kernels for {what}, about {seconds:.0f} s ({again})")

    def on_end(self, event) -> None:
        if event.data["dispatcher"] in KERNELS:
            self.tell(event.data["dispatcher"])


def _purpose(kernel) -> str:
    return PURPOSES.get(_module(kernel), RECONSTRUCTION)


_WATCH = _Watch()
event.register("numba:compile", _WATCH)

# No fastmath, which would be 5 % faster: the last bit would depend on what the compiler makes of a kernel, and that
# differs between one just compiled and the same one from the cache.
parallel = _kept(parallel=True, nogil=True)
serial = _kept()
line = njit(error_model="numpy")                            # called for a line of pixels or cells
inline = njit(inline="always", error_model="numpy")
