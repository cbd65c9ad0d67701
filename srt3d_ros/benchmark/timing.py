"""Timing in turns, so that whatever else the machine does affects all works alike; peak memory; what is being done."""

import ctypes
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

WAKE_S = 0.05           # of work before a GPU is timed: an idle one runs at a fraction of its clock
PROCESS = Path("/proc/self")
FORGET_PEAK = "5"       # written to clear_refs, proc(5)


class Progress(tqdm):
    """What is being done of a part, on stderr; where that is no terminal, a line every ten seconds."""

    def __init__(self, part: str, place: str = ""):
        self._part, self._title, self._live = part, f"{place} {part}", sys.stderr.isatty()
        super().__init__(bar_format="{desc} [{elapsed}]", mininterval=0.1 if self._live else 10.0, file=sys.stderr,
                         leave=self._live)

    def show(self, activity: str) -> None:
        """Show what is being done now."""
        self.set_description_str(f"{self._title}: {activity}", refresh=self._live)
        self.update()

    def note(self, text: str) -> None:
        """Say what the user should know, in a line of its own."""
        self.write(f"srt3d: {self._part}: {text}", file=sys.stderr)


@dataclass(eq=False)
class Work:
    """Something to time, and what was measured of it.

    Args:
        call: does it once.
        title: for the progress.
        facts: of the line of results; with "device": on "cuda" the time is until the device is done.
        seconds: of each timed run.
        memory: of the first run, bytes.
    """

    call: Callable[[], object]
    title: str
    facts: dict
    seconds: list[float] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)

    @property
    def median_ms(self) -> float:
        return 1e3 * float(np.median(self.seconds))

    def line(self) -> dict:
        """The line of results: the times in milliseconds, to five digits."""
        ms = {name: float(f"{1e3 * how(self.seconds):.5g}")
              for name, how in (("min", min), ("median", np.median), ("max", max))}
        return self.facts | {"ms": ms, "repeats": len(self.seconds)} | self.memory


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
    for _ in range(repeats):
        for work in works:
            if not work.seconds or sum(work.seconds) < limit_s:
                bar.show(work.title)
                work.seconds.append(timed(work))


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
    return elapsed


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


def peak_memory(call: Callable[[], object]) -> tuple:
    """What call() returns, and the most memory that this process held meanwhile, bytes.

    "growth_bytes": the peak less what was held before; "process_peak_bytes": of the whole process, Python and torch
    included. Neither where the kernel does not forget an earlier peak.
    """
    ctypes.CDLL(None).malloc_trim(0)        # freed memory goes back to the system, so that it counts when used again
    try:
        (PROCESS / "clear_refs").write_text(FORGET_PEAK)
    except OSError:
        return call(), {}
    before = _status_bytes("VmRSS")
    result = call()
    peak = _status_bytes("VmHWM")
    return result, {"growth_bytes": max(peak - before, 0), "process_peak_bytes": peak}


def _status_bytes(name: str) -> int:
    """A size in the status of this process, such as VmRSS, bytes."""
    status = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
    return int(status[name].split()[0]) * 1024
