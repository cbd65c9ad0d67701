"""The fuzz targets: functions that take bytes from outside, each with examples to begin from.

A target reads its bytes or raises InvalidInput with one line that names what cannot be used. Whatever the bytes: no
other exception, no crash, at most a second of work, no memory out of proportion.
"""

import importlib
import resource
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from srt3d_ros.errors import InvalidInput

MAX_SECONDS = 1.0           # of this process's own time: another's load is not the input's fault
MAX_GROWTH_KB = 256 * 1024  # of the largest memory that the process ever had
MAX_LINE = 1000             # characters
Made = tuple[Callable[[bytes], object], Iterable[bytes]]


class Defect(Exception):
    """A target neither read its input nor refused it as it should."""


@dataclass(frozen=True)
class Target:
    """A way in.

    Args:
        make: returns the function that takes the bytes, and the examples; called in the process that tries them.
        rounds: how many inputs to try by default; slow targets have fewer.
        seconds: how long one input may take.
        environment: variables of the process that tries them.
    """

    name: str
    make: Callable[[], Made]
    rounds: int = 50_000
    seconds: float = MAX_SECONDS
    environment: dict[str, str] = field(default_factory=dict)


def try_input(target: Target, read: Callable[[bytes], object], raw: bytes) -> bool:
    """True if the target read the bytes, False if it refused them in one line; Defect otherwise."""
    began, peak_kb = time.process_time(), _peak_kb()
    try:
        read(raw)
        was_read = True
    except InvalidInput as error:
        was_read = False
        line = str(error)
        if not (line.isprintable() and " is " in line and ": expected " in line and len(line) <= MAX_LINE):
            raise Defect(f"{target.name}: a line of {len(line)} characters that does not say what was expected: "
                         f"{line[:300]}") from error
    except (Exception, SystemExit) as error:
        raise Defect(f"{target.name}: {type(error).__name__}: {error}") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":        # of libraries written in Rust
            raise
        raise Defect(f"{target.name}: {error}") from error
    took_s, grown_kb = time.process_time() - began, _peak_kb() - peak_kb
    if took_s > target.seconds:
        raise Defect(f"{target.name}: {took_s:.1f} s of work for {len(raw)} bytes")
    if grown_kb > MAX_GROWTH_KB:
        raise Defect(f"{target.name}: {grown_kb // 1024} MB of memory for {len(raw)} bytes")
    return was_read


def targets() -> dict[str, Target]:
    """All targets by name."""
    modules = [importlib.import_module(f"robustness.targets_{of}") for of in ("messages", "files", "commands")]
    return {target.name: target for module in modules for target in module.TARGETS}


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
