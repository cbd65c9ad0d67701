"""Call a function in a child process: readers written in C, C++ or Rust may crash, hang or take all memory."""

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import NoReturn

import numpy as np

from srt3d_ros.errors import InvalidInput, printable
from srt3d_ros.processes import wait_or_kill

MAX_REASON = 300            # characters of a library's message: a line, with room for the name of the file
GRACE_S = 1.0               # after Ctrl-C, for the child, which gets it too, to remove what it has half written
# Exit codes of the child. Not 0: a library may end the process as if all were well.
_DONE, _REFUSED, _FAILED, _MISSING, _NO_MEMORY, _INTERRUPTED = 10, 11, 12, 13, 14, 130
# Modules are looked for where this process looks for them, and not in the working directory, which may be a stranger's.
_CHILD = ("import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
          "from srt3d_ros import bounded_call; bounded_call.answer(sys.argv[2], int(sys.argv[3]))")


class ChildFailed(Exception):
    """A child process gave no result; the text says why, to stand after its name: 'ended with SIGSEGV'."""


def call(function: Callable[..., dict[str, np.ndarray]], *arguments, memory_bytes: int | None = None,
         timeout_s: float | None = None) -> dict[str, np.ndarray]:
    """What a function returns for these arguments when a child process calls it.

    The function writes to this process's stdout and sys.stderr; what its libraries write to stderr is discarded.

    Args:
        function: of a module, found by its name; returns arrays by name, none of Python objects.
        arguments: what JSON can hold.
        memory_bytes: of address space that the function may take.
        timeout_s: after which the child is killed.

    Raises:
        InvalidInput, ModuleNotFoundError: the function raised it.
        ChildFailed: the function raised anything else, ended its process, or went beyond a bound.
    """
    request = json.dumps({"module": function.__module__, "name": function.__qualname__, "arguments": arguments,
                          "memory_bytes": memory_bytes, "timeout_s": timeout_s})
    with open(os.memfd_create("result"), "w+b") as result:
        command = [sys.executable, "-P", "-c", _CHILD, json.dumps(sys.path), request, str(result.fileno())]
        code = _exit_code(command, result.fileno(), timeout_s)
        result.seek(0)
        if code == _DONE:
            with np.load(result, allow_pickle=False) as arrays:
                return dict(arrays)
        if code == _REFUSED:
            raise InvalidInput(*json.load(result))
        if code == _MISSING:
            text, name = json.load(result)
            raise ModuleNotFoundError(text, name=name)
        if code == _FAILED:
            raise ChildFailed(json.load(result))
    if code == _INTERRUPTED:
        raise KeyboardInterrupt
    if code == _NO_MEMORY:
        raise ChildFailed(f"takes more than {memory_bytes / 2**30:.3g} GiB of memory")
    raise ChildFailed(f"ended with {signal.Signals(-code).name if code < 0 else f'exit code {code}'}")


def answer(request: str, result_fd: int) -> NoReturn:
    """In the child: call the function that `call` names, write its result or error to the file, and end."""
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    asked = json.loads(request)
    with open(result_fd, "w+b") as result:
        try:
            function = getattr(importlib.import_module(asked["module"]), asked["name"])
            _bound(asked["memory_bytes"], asked["timeout_s"])
            np.savez(result, **function(*asked["arguments"]))
            code, reason = _DONE, None
        except InvalidInput as error:
            code, reason = _REFUSED, [error.field, error.value, error.expected]
        except ModuleNotFoundError as error:
            code, reason = _MISSING, [str(error), error.name]
        except MemoryError:
            code, reason = _NO_MEMORY, None
        except KeyboardInterrupt:
            code, reason = _INTERRUPTED, None
        except Exception as error:      # of a library: whatever it likes
            code, reason = _FAILED, printable(f"failed: {type(error).__name__}: {str(error)[:MAX_REASON]}")
        if reason is not None:
            result.seek(0)
            result.truncate()
            result.write(json.dumps(reason, default=str).encode())
    sys.exit(code)


def _exit_code(command: list[str], result_fd: int, timeout_s: float | None) -> int:
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=(result_fd,)) as process:
        try:
            return process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            raise ChildFailed(f"takes longer than {timeout_s:g} s") from None
        except BaseException:       # Ctrl-C
            wait_or_kill(process, GRACE_S)
            raise


def _bound(memory_bytes: int | None, timeout_s: float | None) -> None:
    """Have the kernel enforce the bounds, even after the parent has ended, and leave no core file."""
    _limit(resource.RLIMIT_CORE, 0)
    if timeout_s is not None:
        _limit(resource.RLIMIT_CPU, int(timeout_s) + 1)
    if memory_bytes is not None:
        with open("/proc/self/statm", encoding="ascii") as sizes:
            used = int(sizes.read().split()[0]) * resource.getpagesize()
        _limit(resource.RLIMIT_AS, used + memory_bytes)


def _limit(which: int, most: int) -> None:
    """Lower a limit, never raise it."""
    _, hard = resource.getrlimit(which)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(which, (most, most))
