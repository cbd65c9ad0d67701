"""The fuzz targets: functions that take bytes from outside, and what damages the examples that they begin from.

A target reads its bytes or raises InvalidInput with one line that names what cannot be used. Whatever the bytes: no
other exception, no crash, at most a second of work, no memory out of proportion.
"""

import random
import re
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass

from srt3d_ros.errors import InvalidInput

MAX_SECONDS = 1.0           # of this process's own time: another's load is not the input's fault
MAX_GROWTH_KB = 256 * 1024  # of the largest memory that the process ever had
NUMBERS = (0, 1, 255, 2**15, 2**16 - 1, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
TEXTS = (b"nan", b"-inf", b"1e999", b"-1", b"0", b"9" * 400, b"null", b"[", b"{}", b'""', b"\xff", b"\0", b"\r\n")
NUMBER_AS_TEXT = re.compile(rb"-?\d[\d.]*(?:[eE][+-]?\d+)?")
Made = tuple[Callable[[bytes], object], list[bytes]]


class Defect(Exception):
    """A target neither read its input nor refused it as it should."""


@dataclass(frozen=True)
class Target:
    """Something that reads bytes.

    Args:
        make: returns the function that takes the bytes, and the examples; called in the process that tries them.
        rounds: how many inputs to try by default; slow targets have fewer.
    """

    name: str
    make: Callable[[], Made]
    rounds: int


def try_input(name: str, read: Callable[[bytes], object], raw: bytes) -> bool:
    """True if the target read the bytes, False if it refused them in one line; Defect otherwise."""
    began, peak_kb = time.process_time(), _peak_kb()
    try:
        read(raw)
        was_read = True
    except InvalidInput:        # which is one line, whatever was refused
        was_read = False
    except KeyboardInterrupt:
        raise
    except BaseException as error:      # Rust's PanicException, too
        raise Defect(f"{name}: {type(error).__name__}: {error}") from error
    took_s, grown_kb = time.process_time() - began, _peak_kb() - peak_kb
    if took_s > MAX_SECONDS:
        raise Defect(f"{name}: {took_s:.1f} s of work for {len(raw)} bytes")
    if grown_kb > MAX_GROWTH_KB:
        raise Defect(f"{name}: {grown_kb // 1024} MB of memory for {len(raw)} bytes")
    return was_read


def damaged(examples: list[bytes], rng: random.Random) -> bytes:
    """One of the examples with one to four changes: of bits, bytes, or numbers in binary or as text."""
    raw = bytearray(rng.choice(examples))
    for _ in range(rng.choice((1, 1, 2, 4))):
        at, length = rng.randint(0, len(raw)), rng.randint(1, 8)
        match rng.randrange(7):
            case 0:
                raw[at:at + 1] = bytes(byte ^ 1 << rng.randrange(8) for byte in raw[at:at + 1])
            case 1:
                del raw[at:]
            case 2:
                del raw[at:at + length]
            case 3:
                raw[at:at] = rng.randbytes(length)
            case 4:
                other = rng.choice(examples)
                raw[at:at + 8 * length] = other[at:at + 8 * rng.randint(1, 8)]
            case 5:
                width = rng.choice((1, 2, 4, 8))
                at -= at % width
                raw[at:at + width] = rng.choice(NUMBERS).to_bytes(8, "little")[:width]
            case 6:
                if found := NUMBER_AS_TEXT.search(raw, at):
                    raw[found.start():found.end()] = rng.choice(TEXTS)
    return bytes(raw)


def targets() -> dict[str, Target]:
    """All targets by name."""
    from robustness import targets_devices, targets_files, targets_messages
    modules = targets_messages, targets_files, targets_devices
    return {target.name: target for module in modules for target in module.TARGETS}


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
