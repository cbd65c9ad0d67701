"""Jobs: what waits to be written; frames, which are large, are bounded, and the oldest give way."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

_MOST_WAITING = 100_000     # of all kinds: only scalars logged to a disk that hangs come near it


@dataclass(frozen=True, eq=False)
class Job:
    """Something to write."""

    write: Callable[[], None]
    is_frame: bool = False


class Jobs:
    """A queue from any number of threads to one.

    Args:
        most_frames: how many may wait; one more pushes out the oldest, which is counted in `dropped`.
    """

    def __init__(self, most_frames: int):
        self.dropped = 0
        self._most_frames, self._frames = most_frames, 0
        self._jobs: deque[Job] = deque()
        self._changed, self._closed = threading.Condition(), False

    def put(self, job: Job) -> None:
        """Append a job; one that comes after `close` is dropped."""
        with self._changed:
            if self._closed:
                self.dropped += job.is_frame
                return
            if len(self._jobs) >= _MOST_WAITING or job.is_frame and self._frames >= self._most_frames:
                self._drop_oldest(job.is_frame)
            self._jobs.append(job)
            self._frames += job.is_frame
            self._changed.notify()

    def take(self, timeout_s: float) -> Job | None:
        """The oldest job, waiting for one; None after `timeout_s` seconds or when closed and empty."""
        with self._changed:
            if not self._jobs and not self._closed:
                self._changed.wait(timeout_s)
            if not self._jobs:
                return None
            job = self._jobs.popleft()
            self._frames -= job.is_frame
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
                self._frames -= job.is_frame
                self.dropped += 1
                return
