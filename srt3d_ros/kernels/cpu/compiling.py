"""Compile kernels with numba, and keep the machine code on disk."""

import fcntl
import hashlib
import logging
import os
import stat
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial, update_wrapper
from itertools import product
from pathlib import Path

from numba import __version__, config, float32, njit, prange, types
from numba.core import event
from numba.core.caching import FunctionCache

from srt3d_ros.kernels.cpu.spans import columns
from srt3d_ros.kernels.maps import MARGIN

# With OpenMP several threads of a process may call kernels at once; numba's own work queue would abort. A choice in the
# environment wins.
if "NUMBA_THREADING_LAYER" not in os.environ:
    config.THREADING_LAYER = "omp"
LOG = logging.getLogger(__name__)


def _folder() -> tuple[Path | None, str]:
    """The folder of the machine code, in NUMBA_CACHE_DIR or ~/.cache/srt3d_ros, or None; and a problem of it.

    Its name is a hash of all sources of kernels. Numba itself compares the function's own file only, and would run old
    code after a change of a constant or of an inlined function elsewhere. Numba unpickles the files of the folder, so
    nobody else may write to it. A folder that this process can only read, as in an image, is used.
    """
    own, digest = Path(__file__).parent, hashlib.sha256(__version__.encode())
    for file in (*sorted(own.parent.glob("*.py")), *sorted(own.rglob("*.py"))):
        digest.update(file.read_bytes())
    parent = Path("~/.cache")
    try:
        parent = Path(config.CACHE_DIR or Path(os.environ.get("XDG_CACHE_HOME") or parent.expanduser(), "srt3d_ros"))
        folder = Path(parent, f"srt3d-kernels-{digest.hexdigest()[:16]}")
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except (OSError, RuntimeError):         # RuntimeError: this user has no home
        return None, f"{parent} is not writable"
    if found.st_uid != os.getuid():
        return None, f"{folder} is another user's"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return None, f"{folder} is writable for others (chmod go-w)"
    return folder, "" if os.access(folder, os.W_OK) else f"{folder} is not writable"


FOLDER, NOT_KEPT = _folder()            # NOT_KEPT: why compiled kernels are not kept
KERNELS: dict[str, "Kernel"] = {}       # by name
_one_thread = threading.Lock()


def read_only(array: types.Array) -> types.Array:
    """The type of an array that may be read-only, such as one in a message."""
    return array.copy(readonly=True)


# Arrays that kernels take
floats1d, floats2d, floats3d, floats4d = float32[::1], float32[:, ::1], float32[:, :, ::1], float32[:, :, :, ::1]


def compiled_type(annotation):
    """The numba type of an annotation, which is one itself or a NamedTuple class annotated with them."""
    if not isinstance(annotation, type):
        return annotation
    fields = tuple(annotation.__annotations__.values())
    if len(set(fields)) == 1:       # what numba makes of such a tuple
        return types.NamedUniTuple(fields[0], len(fields), annotation)
    return types.NamedTuple(fields, annotation)


class _Locator(FunctionCache._impl_class._locator_classes[0]):      # numba's, for NUMBA_CACHE_DIR
    """Keeps a copy of the package in a part of FOLDER of its own; numba's refuses a folder that it cannot write to."""

    @classmethod
    def from_function(cls, function, file):
        locator = cls(function, file)
        locator._cache_path = str(FOLDER / cls.get_suitable_cache_subpath(file))
        with suppress(OSError):
            Path(locator._cache_path).mkdir(exist_ok=True)
        return locator


class _Cache(FunctionCache):
    _impl_class = type("_Impl", (FunctionCache._impl_class,), {"_locator_classes": [_Locator]})


class Kernel:
    """A function compiled for the types in its annotations; arrays of other types are a TypeError.

    So the sources alone decide what is compiled. Numba by itself would compile again for an array that is contiguous or
    read-only where the first was not. A tuple of types compiles the function for each. A NamedTuple class with a method
    `of` converts its arguments. Numbers are cast; callers pass np.float32 for float32. The first call compiles, or
    reads the machine code from FOLDER.
    """

    def __init__(self, function: Callable, **options):
        self.compiled = njit(error_model="numpy", nogil=True, **options)(function)
        if FOLDER:
            self.compiled._cache = _Cache(function)
        annotations = list(function.__annotations__.values())
        choices = (of if isinstance(of, tuple) else (of,) for of in map(compiled_type, annotations))
        self._converters = {at: of.of for at, of in enumerate(annotations) if hasattr(of, "of")}
        self.signatures, self.is_ready = list(product(*choices)), False
        update_wrapper(self, function)
        KERNELS[self.name] = self

    @property
    def name(self) -> str:
        """Module and function, such as search._search."""
        return f"{self.__module__.rpartition('.')[2]}.{self.__name__}"

    def compile(self) -> None:
        """Compile it, or read it from the disk, unless that has been done.

        Other threads and programs that compile this kernel wait: numba's index of its files has no lock.
        """
        with _one_thread, ExitStack() as lock:
            if folder := self.compiled._cache.cache_path:
                with suppress(OSError):         # where no lock can be written, no machine code can
                    fcntl.flock(lock.enter_context(open(Path(folder, f"{self.name}.lock"), "w")), fcntl.LOCK_EX)
            for signature in () if self.is_ready else self.signatures:
                try:
                    self.compiled.compile(signature)
                except OSError as error:        # the disk failed: it is compiled all the same, unless reading failed
                    if not NOT_KEPT:        # else _Watch has said so
                        LOG.warning(f"compiled kernels cannot be kept in {FOLDER}: {error.strerror}")
                    if signature not in self.compiled.overloads:
                        raise
            self.compiled.disable_compile()
            self.is_ready = True

    def __call__(self, *arguments):
        if not self.is_ready:
            self.compile()
        if _forked_after_use:
            raise RuntimeError("kernels cannot run in a process that was forked after another kernel had run: "
                               "call multiprocessing.set_start_method(\"spawn\") first")
        if self._converters:
            arguments = list(arguments)
            for at, convert in self._converters.items():
                arguments[at] = convert(arguments[at])
        return self.compiled(*arguments)


class _Watch(event.Listener):
    """Log once that kernels are being compiled, not read from the disk."""

    said = False

    def on_start(self, event) -> None:
        if not self.said and (event.data["dispatcher"].__module__ or "").startswith(f"{__package__}."):
            self.said = True
            again = (f"at every start: {NOT_KEPT}; NUMBA_CACHE_DIR names another folder" if NOT_KEPT else
                     "once; `srt3d compile` does it beforehand")
            LOG.info(f"compiling kernels, for seconds up to two minutes ({again})")

    def on_end(self, event) -> None:
        """Required by Listener; unused."""


event.register("numba:compile", _Watch())

# OpenMP kills a process that was forked after its threads had started, and the parent waits for ever.
_forked_after_use = False


def _on_fork() -> None:
    global _forked_after_use
    _forked_after_use = any(kernel.is_ready for kernel in KERNELS.values())


os.register_at_fork(after_in_child=_on_fork)

# Without fastmath, which is 5 % faster: with it, the last bit differs between a kernel just compiled and the same
# kernel from the cache.
parallel = partial(Kernel, parallel={"fusion": False})     # a loop may read what the one before has written
# Without reference counts, which would cost more than many a body: these functions make no arrays.
line = njit(error_model="numpy", _nrt=False)            # called once for a line of pixels or cells
inline = njit(error_model="numpy", _nrt=False, forceinline=True)    # by LLVM: numba's own takes longer to compile


def each(*bodies: Callable) -> Kernel:
    """A kernel that calls one body after the other, each in parallel for the rows of its last argument, a padded map.

    A body(i, …) is called once for the row i, a body(i, j, …) for each vector of its columns j; margins are left out.
    The kernel takes the arguments of all bodies, by name, and is named like the last one.
    """
    scope, rows, loops = {"prange": prange, "columns": columns, "line": line, "MARGIN": MARGIN}, "", ""
    for n, body in enumerate(bodies):
        *_, last = given = list(body.__annotations__)
        takes, is_row = ", ".join(given), body.__code__.co_varnames[1] in given
        scope[f"body{n}"] = line(body) if is_row else inline(body)
        rows += "" if is_row else (f"@line\ndef row{n}(i, {takes}):\n for j in columns({last}):\n"
                                   f"  body{n}(i, j, {takes})\n")
        loops += (f" for i in prange(MARGIN, len({last}) - MARGIN):\n"
                  f"  {'body' if is_row else 'row'}{n}(i, {takes})\n")
    types = {name: of for body in bodies for name, of in body.__annotations__.items()}
    source = f"{rows}def {body.__name__}({', '.join(types)}):\n{loops}"
    exec(compile(source, body.__code__.co_filename, "exec"), scope)     # noqa: S102, since numba takes no *arguments
    function = scope[body.__name__]
    function.__module__, function.__annotations__ = body.__module__, types
    return parallel(function)
