"""Settings that a process needs for large messages: a shared-memory profile for Fast DDS, and memory that is kept.

With the defaults, an 8 MB message takes 25 ms between two processes and a best-effort one rarely arrives at all; with
both settings it takes 4 ms and none is lost.
"""

import contextlib
import ctypes
import fcntl
import os
import re
import socket
import tempfile
import time
from pathlib import Path

from srt3d_ros.files import shared_files
from srt3d_ros.processes.private_network import FIRST_PORT, PORTS

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"      # read by Fast DDS 2; its FASTDDS_ name does nothing there
PROFILE = "config/fastdds_shm.xml"
SEGMENT = "fastrtps_"   # prefix of Fast DDS's files in /dev/shm
SHARED_MEMORY = Path("/dev/shm")
SEGMENT_BYTES = 64 << 20        # of PROFILE: holds several of the largest messages, 8 to 25 MB
LEAST_SEGMENT_BYTES = 4 << 20   # below, Fast DDS's own 0.5 MB is no worse for a message that fits neither
PROCESSES = 4           # that must find room: each allocates its whole segment when it starts
LEAK_AGE_S = 10.0       # older than any segment whose process is still starting

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -2, -3, -8     # glibc's malloc.h

_held: list = []        # sockets and files that stay open as long as this process lives


def prepare_process() -> None:
    """Prepare this process for large messages. Call it before rclpy.init and before any thread starts.

    A profile that the user chose is kept.
    """
    remove_leaked_segments()
    reserve_stale_ports()
    if PROFILE_VARIABLE not in os.environ and (profile := shared_memory_profile()):
        os.environ[PROFILE_VARIABLE] = str(profile)
    _keep_freed_memory()


def remove_leaked_segments(shared_memory: Path = SHARED_MEMORY) -> None:
    """Remove the shared memory of killed processes, up to 64 MB each, which nobody else removes."""
    for lock in shared_memory.glob(SEGMENT + "[0-9a-f]" * 16 + "_el"):
        _remove(lock.with_name(lock.name.removesuffix("_el")))


def reserve_stale_ports(shared_memory: Path = SHARED_MEMORY) -> None:
    """Keep Fast DDS from giving this process a port of shared memory that others still send to for a killed one.

    They find out one after the other, and each makes the port anew: a reader that opens it meanwhile may be left with
    one that nobody writes to, or wait for ever. Fast DDS takes the first ports whose numbers are free on UDP, too. So
    this process holds those of the killed. It removes what nobody sends to any more.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    first = FIRST_PORT + PORTS * (int(domain) if domain.isdecimal() else 0)      # what is none, rcl refuses
    names = {f"{SEGMENT}port{port}": port for port in range(first + 1, first + PORTS)}
    there = names.keys() & {path.name for path in shared_memory.glob(f"{SEGMENT}port*[0-9]")}
    if not there:
        return
    mapped = names.keys() & _mapped(shared_memory)
    for name in there | mapped:
        bound = _bind(names[name] - 1, names[name])     # of one participant: discovery, and data
        if name in mapped:
            _held.extend(bound)
        elif bound:
            _remove(shared_memory / name)
            for one in bound:
                one.close()


def _remove(path: Path) -> None:
    """Remove a file of shared memory and the one beside it on which the process that reads there holds a lock."""
    lock = path.with_name(f"{path.name}_el")
    with contextlib.suppress(OSError):      # in use, another user's, or removed by another process just now
        times = [one.stat().st_mtime for one in (path, lock) if one.exists()]
        if not times or time.time() - max(times) < LEAK_AGE_S:
            return
        with lock.open("ab") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink(missing_ok=True)
            lock.unlink()


def _mapped(folder: Path) -> set[str]:
    """Names of the files of a folder that any process of this user has in memory."""
    found = set()
    line = re.compile(rf" {re.escape(str(folder))}/(\S+)(?: \(deleted\))?$", re.MULTILINE)
    for process in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):      # it has ended, or is another user's
            found.update(line.findall(Path("/proc", process, "maps").read_text(errors="replace")))
    return found


def _bind(*ports: int) -> list[socket.socket]:
    """UDP sockets at these ports; none if one of them is in use."""
    with contextlib.ExitStack() as opened:
        bound = [opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in ports]
        for one, port in zip(bound, ports):
            try:
                one.bind(("", port))
            except OSError:
                return []
        opened.pop_all()
        return bound


def shared_memory_profile(shared_memory: Path = SHARED_MEMORY) -> Path | None:
    """A Fast DDS profile whose segment fits PROCESSES times into free shared memory, or None if there is no room.

    That is config/fastdds_shm.xml where 64 MB fit, else a copy with a smaller segment, removed when this process ends.
    """
    try:
        room = os.statvfs(shared_memory)
    except OSError:
        return None
    segment_bytes = min(SEGMENT_BYTES, room.f_bavail * room.f_frsize // PROCESSES)
    profile = shared_files.find(PROFILE)
    if segment_bytes == SEGMENT_BYTES or profile is None:
        return profile
    if segment_bytes < LEAST_SEGMENT_BYTES:
        return None
    smaller = tempfile.NamedTemporaryFile("w", prefix="srt3d_fastdds_", suffix=".xml")
    smaller.write(profile.read_text(encoding="utf-8").replace(f">{SEGMENT_BYTES}<", f">{segment_bytes}<"))
    smaller.flush()
    _held.append(smaller)
    return Path(smaller.name)


def _keep_freed_memory() -> None:
    """Stop glibc from returning every large buffer to the system and faulting it in again for the next message."""
    mallopt = ctypes.CDLL(None).mallopt
    mallopt(M_MMAP_THRESHOLD, 1 << 30)
    mallopt(M_TRIM_THRESHOLD, 1 << 30)
    mallopt(M_TOP_PAD, 64 << 20)
    mallopt(M_ARENA_MAX, 1)         # those of threads return every buffer above 64 MB, whatever the thresholds
