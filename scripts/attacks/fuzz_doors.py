"""The doors through which strangers' bytes come in, with examples to begin from; and what must hold at all of them.

A door takes bytes and either reads them or raises InvalidInput with one line that names what cannot be used. Whatever
the bytes: no other exception, no crash, not more than a second of work, no memory out of proportion.
"""

import resource
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from srt3d_ros.errors import InvalidInput

MAX_SECONDS = 1.0           # of this process's own time: another's load is not the input's fault
MAX_GROWTH_KB = 256 * 1024  # of the largest memory that the process ever had
MAX_LINE = 1000             # characters


class Defect(Exception):
    """A door that does not keep its promise."""


@dataclass(frozen=True)
class Door:
    """A way in.

    Args:
        name: of the door.
        make: gives the function that takes the bytes, and the examples; called once, where the bytes are to be tried.
        runs: how many inputs make a fair attack, beside those of other doors: slow doors have fewer.
        seconds: how long one input may take, where reading means to start something large first.
    """

    name: str
    make: Callable[[], tuple[Callable[[bytes], object], Iterable[bytes]]]
    runs: int = 50_000
    seconds: float = MAX_SECONDS


def knock(door: Door, read: Callable[[bytes], object], raw: bytes) -> bool:
    """True if the door read the bytes, False if it refused them as it should.

    Raises:
        Defect: anything else.
    """
    began, peak_kb = time.process_time(), _peak_kb()
    try:
        read(raw)
        was_read = True
    except InvalidInput as error:
        was_read = False
        _check_line(door, str(error))
    except (Exception, SystemExit) as error:
        raise Defect(f"{door.name}: {type(error).__name__}: {error}") from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":        # of libraries written in Rust
            raise
        raise Defect(f"{door.name}: {error}") from error
    took_s, grown_kb = time.process_time() - began, _peak_kb() - peak_kb
    if took_s > door.seconds:
        raise Defect(f"{door.name}: {took_s:.1f} s of work for {len(raw)} bytes")
    if grown_kb > MAX_GROWTH_KB:
        raise Defect(f"{door.name}: {grown_kb // 1024} MB of memory for {len(raw)} bytes")
    return was_read


def doors() -> dict[str, Door]:
    """All doors by name."""
    import fuzz_commands
    import fuzz_files
    import fuzz_messages

    return {door.name: door for module in (fuzz_messages, fuzz_files, fuzz_commands) for door in module.DOORS}


def _check_line(door: Door, line: str) -> None:
    if not (line.isprintable() and " is " in line and ": expected " in line and len(line) <= MAX_LINE):
        raise Defect(f"{door.name}: a line of {len(line)} characters that does not say what was expected: {line[:300]}")


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
