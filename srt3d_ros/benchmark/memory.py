"""The most memory that this process held while something ran, as the kernel counts it."""

import ctypes
from pathlib import Path

PROCESS = Path("/proc/self")
FORGET_PEAK = "5"           # written to clear_refs, proc(5)


class PeakMemory:
    """A context manager; freed memory is first given back to the system, so that it counts again when it is used.

    `growth_bytes`: the peak less what was held before; `process_bytes`: the peak of the whole process, Python and torch
    included. Both None where the kernel does not forget an earlier peak.
    """

    def __init__(self, process: Path = PROCESS):
        self._process = process
        self.growth_bytes: int | None = None
        self.process_bytes: int | None = None

    def __enter__(self) -> "PeakMemory":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:            # absent on musl
            trim(0)
        try:
            (self._process / "clear_refs").write_text(FORGET_PEAK)
            self._before = self._read("VmRSS")
        except OSError:
            self._before = None
        return self

    def __exit__(self, *exc) -> None:
        if self._before is not None:
            self.process_bytes = self._read("VmHWM")
            self.growth_bytes = max(self.process_bytes - self._before, 0)

    def _read(self, name: str) -> int:
        """A size of /proc/self/status, bytes."""
        for line in (self._process / "status").read_text().splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
        raise OSError(f"{name} is not in {self._process}/status")
