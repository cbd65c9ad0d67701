"""What processes hold while they run, as the kernel counts it: memory, files, threads, shared memory, CPU time."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import psutil

SHARED = Path("/dev/shm")
HELD = ("rss_mb", "uss_mb", "fds", "threads")       # of each process
MB = 1e6


class Samples:
    """One sample after the other of the same processes.

    Args:
        pids: of the processes, by name.

    Attributes:
        time_s: of each sample.
        held: {process: {one of HELD, or cpu_s: values}}.
        shm_entries, shm_mb: files in /dev/shm that one of the processes has ever been seen to use, and that are still
            there; and the memory that these take.
    """

    def __init__(self, pids: Mapping[str, int]):
        self._processes = {name: psutil.Process(pid) for name, pid in pids.items()}
        self.time_s: list[float] = []
        self.held = {name: {kind: [] for kind in (*HELD, "cpu_s")} for name in pids}
        self.shm_entries: list[int] = []
        self.shm_mb: list[float] = []
        self._shared: set[Path] = set()

    def take(self, time_s: float) -> None:
        """Take a sample; psutil.NoSuchProcess if one of them has ended."""
        for name, process in self._processes.items():
            memory, cpu = process.memory_full_info(), process.cpu_times()
            values = (memory.rss / MB, memory.uss / MB, process.num_fds(), process.num_threads(), cpu.user + cpu.system)
            for kind, value in zip((*HELD, "cpu_s"), values, strict=True):
                self.held[name][kind].append(value)
            self._shared |= _shared_by(process.pid)
        there = [path.stat() for path in self._shared if path.exists()]
        self.shm_entries.append(len(there))
        self.shm_mb.append(sum(file.st_blocks for file in there) * 512 / MB)
        self.time_s.append(time_s)

    def cpu_percent(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Times, and the CPU of a process between two samples, % of a core."""
        time_s, used_s = np.array(self.time_s), np.array(self.held[name]["cpu_s"])
        return time_s[1:], 100 * np.diff(used_s) / np.diff(time_s)


def _shared_by(pid: int) -> set[Path]:
    """The files in /dev/shm that a process has mapped."""
    maps = Path(f"/proc/{pid}/maps").read_text().splitlines()
    paths = (line.split(maxsplit=5)[5] for line in maps if f" {SHARED}/" in line)
    return {Path(path) for path in paths if not path.endswith("(deleted)")}
