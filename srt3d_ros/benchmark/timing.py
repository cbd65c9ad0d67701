"""Timing works in turns, so that whatever else the machine does falls on all of them alike."""

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from srt3d_ros.benchmark.memory import PeakMemory
from srt3d_ros.benchmark.progress import Progress

WAKE_S = 0.05           # of work before a GPU is timed: an idle one runs at a fraction of its clock


@dataclass(frozen=True, eq=False)
class Work:
    """What is timed.

    Args:
        call: does it once.
        device: where it computes; on "cuda" the time is until the device is done.
        title: for the progress bar.
        settles: True if its first run also allocates or captures what later ones use: it is then not timed. The first
            run is the one whose memory is measured.
        frames: that a call does; the time is that of one.
    """

    call: Callable[[], object]
    device: str
    title: str
    settles: bool = True
    frames: int = 1


@dataclass(eq=False)
class Timing:
    """What was measured of a work: the seconds of each timed run, and the memory of the first."""

    seconds: list[float] = field(default_factory=list)
    growth_bytes: int | None = None
    process_peak_bytes: int | None = None
    device_peak_bytes: int | None = None

    @property
    def median_ms(self) -> float:
        return 1e3 * float(np.median(self.seconds))

    def figures(self) -> dict:
        """For the results."""
        memory = {name: value for name in ("growth_bytes", "process_peak_bytes", "device_peak_bytes")
                  if (value := getattr(self, name)) is not None}
        return {"ms": spread([1e3 * s for s in self.seconds]), "repeats": len(self.seconds), **memory}


def spread(values: list[float]) -> dict[str, float]:
    """min, median and max, to five digits."""
    return {name: float(f"{how(values):.5g}") for name, how in (("min", min), ("median", np.median), ("max", max))}


def in_turns(works: dict[Hashable, Work], repeats: int, bar: Progress,
             patience_s: float = np.inf) -> dict[Hashable, Timing]:
    """Time each work `repeats` times, all of them once before any is timed again.

    A work is not repeated once its runs have taken `patience_s` together; it is timed at least once. The bar moves by
    `runs(works, repeats)`.
    """
    timings = {}
    for key, work in works.items():
        bar.says(work.title)
        timings[key] = _first(work)
        bar.update()
    for done in range(repeats):
        for key, work in works.items():
            timing = timings[key]
            wanted = len(timing.seconds) <= done
            if wanted and (not timing.seconds or sum(timing.seconds) < patience_s):
                bar.says(work.title)
                timing.seconds.append(timed(work))
            bar.update()
    return timings


def runs(works: int, repeats: int) -> int:
    """By how much the bar moves for so many works."""
    return works * (repeats + 1)


def timed(work: Work) -> float:
    """The seconds that it takes once."""
    if work.device == "cuda":
        deadline = time.perf_counter() + WAKE_S
        while time.perf_counter() < deadline:
            work.call()
    return _seconds(work)


def _seconds(work: Work) -> float:
    synchronise(work.device)
    started = time.perf_counter()
    result = work.call()
    synchronise(work.device)
    elapsed = time.perf_counter() - started
    del result              # not within the time: what a user does with a cloud is his
    return elapsed / work.frames


def _first(work: Work) -> Timing:
    """The first run: its memory, and its time if it settles nothing."""
    timing = Timing()
    if work.device == "cuda":
        import torch
        torch.cuda.reset_peak_memory_stats()
    with PeakMemory() as memory:
        seconds = _seconds(work)
    if work.device == "cuda":
        timing.device_peak_bytes = torch.cuda.max_memory_allocated()
    timing.growth_bytes, timing.process_peak_bytes = memory.growth_bytes, memory.process_bytes
    if not work.settles:
        timing.seconds.append(seconds)
    return timing


def synchronise(device: str) -> None:
    """Wait until the device has done all it was asked to."""
    if device == "cuda":
        import torch
        torch.cuda.synchronize()
