"""Jobs: what waits to be written; the memory of clouds and images is bounded, and the oldest give way."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

_MOST_WAITING = 100_000     # of all kinds: only scalars logged to a disk that hangs come near it


@dataclass(frozen=True, eq=False)
class Job:
    """Something to write; `size` bytes of a cloud or an image, 0 of what is small and never to be dropped."""

    write: Callable[[], None]
    size: int = 0

    @property
    def is_frame(self) -> bool:
        """Whether it is a cloud or an image."""
        return self.size > 0


class Jobs:
    """A queue from any number of threads to one.

    Args:
        most_bytes: of frames that may wait, but one always may; more push out the oldest, counted in `dropped`.
    """

    def __init__(self, most_bytes: int):
        self.dropped = 0
        self._most_bytes, self._bytes = most_bytes, 0
        self._jobs: deque[Job] = deque()
        self._changed, self._closed = threading.Condition(), False

    def put(self, job: Job) -> None:
        """Append a job; one that comes after `close` is dropped."""
        with self._changed:
            if self._closed:
                self.dropped += job.is_frame
                return
            if len(self._jobs) >= _MOST_WAITING:
                self._drop_oldest(frames_only=False)
            while job.is_frame and self._bytes and self._bytes + job.size > self._most_bytes:
                self._drop_oldest(frames_only=True)
            self._jobs.append(job)
            self._bytes += job.size
            self._changed.notify()

    def take(self, timeout_s: float) -> Job | None:
        """The oldest job, waiting for one; None after `timeout_s` seconds or when closed and empty."""
        with self._changed:
            if not self._jobs and not self._closed:
                self._changed.wait(timeout_s)
            if not self._jobs:
                return None
            job = self._jobs.popleft()
            self._bytes -= job.size
            return job

    def count_dropped(self, job: Job) -> None:
        """Count a job that was taken and could not be done."""
        with self._changed:
            self.dropped += job.is_frame

    def close(self) -> None:
        """Take no more; what waits can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def at_end(self) -> bool:
        """True once closed and empty."""
        with self._changed:
            return self._closed and not self._jobs

    def _drop_oldest(self, frames_only: bool) -> None:
        for k, job in enumerate(self._jobs):
            if job.is_frame >= frames_only:
                del self._jobs[k]
                self._bytes -= job.size
                self.dropped += 1
                return
