"""Settings of a process for large messages: a shared-memory profile for Fast DDS, and reuse of freed memory.

By default, an 8 MB message takes 25 ms between two processes, and with best effort it rarely arrives. With both
settings it takes 4 ms, and none is lost.
"""

import contextlib
import ctypes
import fcntl
import os
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from srt3d_ros.files import shared_file
from srt3d_ros.processes.private_network import FIRST_PORT, PORTS, bind, held


class FastDds(NamedTuple):
    """Names that differ between the major versions of Fast DDS. Each version refuses the other's profiles."""

    library: str                # a folder of libraries has it if this version is installed there
    segment: str                # prefix of the files in /dev/shm
    profiles: str               # pattern of this package's profiles
    variables: tuple[str, ...]      # that name a profile, the preferred one first


FAST_DDS_2 = FastDds("libfastrtps.so", "fastrtps_", "config/fastdds_{}.xml", ("FASTRTPS_DEFAULT_PROFILES_FILE",))
FAST_DDS_3 = FastDds("libfastdds.so", "fastdds_", "config/fastdds3_{}.xml",
                     ("FASTDDS_DEFAULT_PROFILES_FILE", *FAST_DDS_2.variables))      # rmw warns of the second


def installed_fast_dds() -> FastDds:
    """The version that rclpy will load: the first in LD_LIBRARY_PATH or, last, in this Python's own libraries."""
    for folder in (*os.environ.get("LD_LIBRARY_PATH", "").split(":"), f"{sys.prefix}/lib"):
        for version in (FAST_DDS_2, FAST_DDS_3):
            if Path(folder, version.library).exists():
                return version
    return FAST_DDS_3


FAST_DDS = installed_fast_dds()
SHARED_MEMORY = Path("/dev/shm")
SEGMENT_BYTES = 64 << 20        # in our profiles: several of the largest messages, 8 to 25 MB each
LEAST_SEGMENT_BYTES = 4 << 20   # a smaller segment is no better than Fast DDS's default of 0.5 MB
PROCESSES = 4           # that need a segment; each allocates all of it when it starts
LEAK_AGE_S = 10.0       # a younger segment may belong to a process that is still starting

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -2, -3, -8     # glibc's malloc.h


def prepare_process() -> None:
    """Prepare this process for large messages; call it before rclpy.init and before any thread starts.

    A profile that the user has set is kept.
    """
    remove_leaked_segments()
    reserve_stale_ports()
    if os.environ.keys().isdisjoint(FAST_DDS.variables) and (profile := shared_memory_profile()):
        os.environ[FAST_DDS.variables[0]] = str(profile)
    _keep_freed_memory()


def remove_leaked_segments(shared_memory: Path = SHARED_MEMORY) -> None:
    """Remove the shared memory of killed processes, up to 64 MB each, which Fast DDS does not remove."""
    for lock in shared_memory.glob(FAST_DDS.segment + "[0-9a-f]" * 16 + "_el"):
        _remove(lock.with_name(lock.name.removesuffix("_el")))


def reserve_stale_ports(shared_memory: Path = SHARED_MEMORY) -> None:
    """Keep Fast DDS from giving this process a shared-memory port to which others still send for a killed process.

    Each sender notices the killed process at another time, and then creates the port again. A process that opens the
    port meanwhile may read from one that has no writer, or wait for ever. Fast DDS only takes ports whose numbers are
    free on UDP, too, so this process binds the UDP ports of killed processes. It removes ports without senders.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    first = FIRST_PORT + PORTS * (int(domain) if domain.isdecimal() else 0)      # rcl refuses other values
    names = {f"{FAST_DDS.segment}port{port}": port for port in range(first + 1, first + PORTS)}
    existing = names.keys() & {path.name for path in shared_memory.glob(f"{FAST_DDS.segment}port*[0-9]")}
    if not existing:
        return
    mapped = names.keys() & _mapped(shared_memory)
    for name in existing | mapped:
        bound = bind(names[name] - 1, names[name])     # a participant's ports for discovery and data
        if name in mapped:
            held.extend(bound)
        elif bound:
            _remove(shared_memory / name)
            for one in bound:
                one.close()


def _remove(path: Path) -> None:
    """Remove a file of shared memory and its lock file, unless a process holds the lock."""
    lock = path.with_name(f"{path.name}_el")
    with contextlib.suppress(OSError):      # in use, another user's, or already removed
        times = [one.stat().st_mtime for one in (path, lock) if one.exists()]
        if not times or time.time() - max(times) < LEAK_AGE_S:
            return
        with lock.open("ab") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink(missing_ok=True)
            lock.unlink()


def _mapped(folder: Path) -> set[str]:
    """Names of the files in a folder that any process of this user has mapped."""
    found = set()
    line = re.compile(rf" {re.escape(str(folder))}/(\S+)(?: \(deleted\))?$", re.MULTILINE)
    for process in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):      # the process has ended, or is another user's
            found.update(line.findall(Path("/proc", process, "maps").read_text(errors="replace")))
    return found


def shared_memory_profile(shared_memory: Path = SHARED_MEMORY) -> Path | None:
    """A Fast DDS profile whose segment fits PROCESSES times into free shared memory; None if memory is too short.

    It is that in config/ if 64 MB fit, else a temporary copy with a smaller segment.
    """
    try:
        room = os.statvfs(shared_memory)
    except OSError:
        return None
    segment_bytes = min(SEGMENT_BYTES, room.f_bavail * room.f_frsize // PROCESSES)
    profile = shared_file(FAST_DDS.profiles.format("shm"))
    if segment_bytes == SEGMENT_BYTES or profile is None:
        return profile
    if segment_bytes < LEAST_SEGMENT_BYTES:
        return None
    smaller = tempfile.NamedTemporaryFile("w", prefix="srt3d_fastdds_", suffix=".xml")   # noqa: SIM115, held to the end
    smaller.write(profile.read_text(encoding="utf-8").replace(f">{SEGMENT_BYTES}<", f">{segment_bytes}<"))
    smaller.flush()
    held.append(smaller)
    return Path(smaller.name)


def _keep_freed_memory() -> None:
    """Let glibc reuse large buffers, instead of returning each to the system and faulting in the next message's."""
    mallopt = ctypes.CDLL(None).mallopt
    mallopt(M_MMAP_THRESHOLD, 1 << 30)
    mallopt(M_TRIM_THRESHOLD, 1 << 30)
    mallopt(M_TOP_PAD, 64 << 20)
    mallopt(M_ARENA_MAX, 1)         # arenas of threads return buffers above 64 MB whatever the thresholds
