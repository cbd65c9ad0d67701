"""Frames through a sequence of kernels, one after the other, while others come and go.

Three streams of the GPU work at once: one brings frame n + 1, one computes frame n, one takes frame n − 1 back. What is
computed is recorded as a CUDA graph, which starts some dozens of kernels in the time of one. A frame on its way has a
slot, with its memory on the GPU and its own graph; there are two, and `submit` waits for the frame before last. Memory
of the host is pinned, so that copies run by themselves; torch keeps what is given back for the next frame.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import torch

from srt3d_ros.kernels.cuda.device import DEVICE
from srt3d_ros.kernels.reference import unpack

SLOTS = 2
WARM_FRAMES = 2 * SLOTS         # the first frame of a slot compiles, the second is recorded


class FrameStream:
    """Frames through a function, which launches the same kernels for every frame, and waits for none.

    Memory that it keeps may be that of other pipelines too: no two of their frames are computed at once.
    """

    def __init__(self, function: Callable):
        self._function, self._slots, self._submitted = function, {}, 0

    def submit(self, *frame) -> Callable[[], tuple]:
        frame = [values if isinstance(values, torch.Tensor) else _tensor(values) for values in frame]
        if DEVICE == "cpu":                                     # interpreted
            results = self._function(*frame)
            return lambda: _read(results)
        key = tuple((values.shape, values.dtype) for values in frame)
        if key not in self._slots:
            self._slots[key] = [_Slot(self._function, frame) for _ in range(SLOTS)]
        self._submitted += 1
        return self._slots[key][self._submitted % SLOTS].submit(frame)


class _Slot:
    """A frame on its way: its memory on the GPU, and when what is done with it."""

    def __init__(self, function: Callable, frame: list[torch.Tensor]):
        self._function = function
        self._frame = [torch.empty(values.shape, dtype=values.dtype, device=DEVICE) for values in frame]
        torch.cuda.synchronize()            # who had this memory before is done with it: other streams will write there
        self._graph, self._results, self._runs = None, (), 0
        self._computed, self._downloaded = torch.cuda.Event(), torch.cuda.Event()

    def submit(self, frame: list[torch.Tensor]) -> Callable[[], tuple]:
        upload, compute, download = _streams()
        caller = torch.cuda.current_stream()
        self._computed.synchronize()                            # the last frame here: its memory is free
        for values, there in zip(frame, self._frame):
            if values.is_cuda:
                there.copy_(values)                             # by the caller's stream, which made them
            else:
                pinned = torch.empty(values.shape, dtype=values.dtype, pin_memory=True).copy_(values)
                with torch.cuda.stream(upload):
                    there.copy_(pinned, non_blocking=True)
        for earlier in (caller, upload):
            compute.wait_stream(earlier)
        compute.wait_event(self._downloaded)                    # the last results here
        with torch.cuda.stream(compute):
            self._compute(compute)
            self._computed.record(compute)
        download.wait_event(self._computed)
        with torch.cuda.stream(download):
            held = [torch.empty(values.shape, dtype=values.dtype, pin_memory=True) for values in self._results]
            for values, there in zip(self._results, held):
                there.copy_(values, non_blocking=True)
            self._downloaded = torch.cuda.Event()               # a new one: the old may still be waited for
            self._downloaded.record(download)
        return _waiting(self._downloaded, held)

    def _compute(self, stream: torch.cuda.Stream) -> None:
        """The first frame compiles and finds its memory; then what the kernels do is recorded, but not yet done."""
        if self._graph is None and self._runs > 0:
            graph = torch.cuda.CUDAGraph()
            # What other threads do with the GPU meanwhile, such as to wait for a frame, does not spoil the recording.
            with torch.cuda.graph(graph, stream=stream, capture_error_mode="thread_local"):
                self._results = self._function(*self._frame)
            self._graph = graph
        if self._graph is None:
            self._results = self._function(*self._frame)
        else:
            self._graph.replay()
        self._runs += 1


def _waiting(downloaded: torch.cuda.Event, held: list[torch.Tensor]) -> Callable[[], tuple]:
    """What waits for results on their way to the host."""
    def wait() -> tuple:
        downloaded.synchronize()
        return _read(held)
    return wait


def _read(results) -> tuple:
    *arrays, points, number = results
    return *(values.numpy() for values in arrays), *unpack((points, number))


def _tensor(values: np.ndarray) -> torch.Tensor:
    """The same memory as a tensor; a copy where torch has no such tensors."""
    values = np.ascontiguousarray(values)
    return torch.from_numpy(values if values.flags.writeable else values.copy())


@lru_cache
def _streams() -> tuple[torch.cuda.Stream, torch.cuda.Stream, torch.cuda.Stream]:
    """For uploads, kernels and downloads: one of each, so that frames that share memory are computed in turn."""
    return torch.cuda.Stream(), torch.cuda.Stream(), torch.cuda.Stream()
