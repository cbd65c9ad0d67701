"""Timing in turns, so that whatever else the machine does affects all works alike; peak memory; the progress bar."""

import ctypes
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

WAKE_S = 0.05           # of work before a GPU is timed: an idle one runs at a fraction of its clock
BAR = "{desc:<50} |{bar:20}| {n_fmt}/{total_fmt} [{elapsed}]"
FORGET_PEAK = "5"       # written to clear_refs, proc(5)


class Progress(tqdm):
    """A bar on stderr that begins with `title`; where that is no terminal, a line every ten seconds."""

    def __init__(self, title: str, steps: int):
        self._title, self._live = title, sys.stderr.isatty()
        super().__init__(total=steps, mininterval=0.1 if self._live else 10.0, bar_format=BAR, file=sys.stderr,
                         leave=self._live)

    def show(self, activity: str) -> None:
        """Show what is being done now."""
        self.set_description_str(f"{self._title}: {activity}", refresh=self._live)

    def update(self, n: float = 1) -> bool | None:
        """Move by n, no further than to the end: a search may take more steps than were foreseen."""
        return super().update(min(n, self.total - self.n))


@dataclass(eq=False)
class Work:
    """Something to time, and what was measured of it.

    Args:
        call: does it once.
        title: for the progress bar.
        facts: of the line of results; with "device": on "cuda" the time is until the device is done.
        frames: that a call does; the time is that of one.
        seconds: of each timed run.
        memory: of the first run, bytes.
    """

    call: Callable[[], object]
    title: str
    facts: dict
    frames: int = 1
    seconds: list[float] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)

    @property
    def median_ms(self) -> float:
        return 1e3 * float(np.median(self.seconds))

    def line(self) -> dict:
        """The line of results."""
        return self.facts | {"ms": spread([1e3 * s for s in self.seconds]), "repeats": len(self.seconds)} | self.memory


def spread(values: list[float]) -> dict[str, float]:
    """min, median and max, to five digits."""
    return {name: float(f"{how(values):.5g}") for name, how in (("min", min), ("median", np.median), ("max", max))}


def in_turns(works: Sequence[Work], repeats: int, bar: Progress, limit_s: float = np.inf) -> None:
    """Time each work `repeats` times, all of them once before any is timed again.

    The first run is not timed, since it may allocate or capture what later ones use; its memory is measured. A work is
    not repeated once its runs have taken `limit_s` together: a first run that takes so long is the one that counts.
    """
    for work in works:
        bar.show(work.title)
        seconds = _first_run(work)
        if seconds >= limit_s:
            work.seconds.append(seconds)
        bar.update()
    for _ in range(repeats):
        for work in works:
            if not work.seconds or sum(work.seconds) < limit_s:
                bar.show(work.title)
                work.seconds.append(timed(work))
            bar.update()


def runs(works: int, repeats: int) -> int:
    """By how much `in_turns` moves the bar for so many works."""
    return works * (repeats + 1)


def timed(work: Work) -> float:
    """The seconds that a frame takes, on a device that is awake."""
    if work.facts["device"] == "cuda":
        deadline = time.perf_counter() + WAKE_S
        while time.perf_counter() < deadline:
            work.call()
    return _seconds(work)


def _seconds(work: Work) -> float:
    synchronise(work.facts["device"])
    started = time.perf_counter()
    result = work.call()
    synchronise(work.facts["device"])
    elapsed = time.perf_counter() - started
    del result              # not within the time
    return elapsed / work.frames


def _first_run(work: Work) -> float:
    """Measure the memory; returns the seconds."""
    if work.facts["device"] != "cuda":
        seconds, work.memory = peak_memory(lambda: _seconds(work))
        return seconds
    import torch
    torch.cuda.reset_peak_memory_stats()
    seconds, work.memory = peak_memory(lambda: _seconds(work))
    work.memory["device_peak_bytes"] = torch.cuda.max_memory_allocated()
    return seconds


def synchronise(device: str) -> None:
    """Wait until the device has done all it was asked to."""
    if device == "cuda":
        import torch
        torch.cuda.synchronize()


def peak_memory(call: Callable[[], object], process: Path = Path("/proc/self")) -> tuple:
    """What call() returns, and the most memory that this process held meanwhile, bytes.

    "growth_bytes": the peak less what was held before; "process_peak_bytes": of the whole process, Python and torch
    included. Neither where the kernel does not forget an earlier peak.
    """
    ctypes.CDLL(None).malloc_trim(0)        # freed memory goes back to the system, so that it counts when used again
    try:
        (process / "clear_refs").write_text(FORGET_PEAK)
    except OSError:
        return call(), {}
    before = status_bytes("VmRSS", process)
    result = call()
    peak = status_bytes("VmHWM", process)
    return result, {"growth_bytes": max(peak - before, 0), "process_peak_bytes": peak}


def status_bytes(name: str, process: Path) -> int:
    """A size in the status of /proc/PID, such as VmRSS, bytes."""
    for line in (process / "status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise OSError(f"{name} is not in {process}/status")
