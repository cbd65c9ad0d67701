"""One thread that does a node's work, so that the executor never blocks."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

NEWEST_ONLY = 1
PATIENCE_S = 0.25       # for which frames may wait while a busy machine catches up
CALM_S = 1.0            # without a frame given up: it has caught up
MOST_WAITING = 64       # messages, however patient: bounds the memory
LOSSLESS = 256          # frames that may wait when none may be dropped; bounds the memory if the sender does not


class Dropped(Exception):
    """Raised by a job for a frame it cannot use, through nobody's mistake.

    Args:
        cause: under which it is counted.
        why: for the log.
    """

    def __init__(self, cause: str, why: str):
        super().__init__(why)
        self.cause = cause


@dataclass(frozen=True, eq=False)
class _Job:
    function: Callable
    args: tuple
    is_frame: bool
    since_s: float = field(default_factory=lambda: time.monotonic())


class Worker:
    """Runs jobs in the order in which they came. Frames may push each other out of the queue; other jobs never are.

    A machine that is held up for a moment catches up: nothing is lost while no frame waits longer than `patience_s`.
    One that cannot keep up has only `limit` frames wait, so that none is older than it has to be, until no frame was
    given up for CALM_S.

    Args:
        limit: frames that may wait. A frame too many pushes out the oldest: with 1, the newest frame is always next.
            Where several messages make a frame, `messages_per_frame` says how many, and each is a frame to all else.
        patience_s: how long more frames than that may wait; 0: not at all.
        failed: called with (exception, is_frame) when a job raises; the worker goes on.
        dropped: called with (cause, frames) for waiting frames that are given up: "queue" if newer ones push them out.
    """

    def __init__(self, limit: int, failed: Callable[[Exception, bool], None], dropped: Callable[[str, int], None],
                 patience_s: float = 0.0):
        self.limit, self._failed, self._dropped, self._patience_s = limit, failed, dropped, patience_s
        self.messages_per_frame = 1
        self._calm_from_s = 0.0
        self._jobs: deque[_Job] = deque()
        self._frames_waiting = 0
        self._holding = False
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def call(self, function: Callable, *args) -> None:
        """Run function(*args) after what is already waiting."""
        self._put(_Job(function, args, is_frame=False))

    def offer(self, function: Callable, *args) -> None:
        """Run function(*args) for a frame, unless newer frames push it out first."""
        self._put(_Job(function, args, is_frame=True))

    def hold_frames(self) -> None:
        """Let frames wait in the queue (other jobs run) until `release_frames`."""
        self._holding = True

    def release_frames(self) -> None:
        """Take frames again."""
        with self._changed:
            self._holding = False
            self._changed.notify_all()

    def clear(self, cause: str) -> None:
        """Give up the frames that wait; other jobs stay."""
        with self._changed:
            given_up, self._frames_waiting = self._frames_waiting, 0
            self._jobs = deque(job for job in self._jobs if not job.is_frame)
        if given_up:
            self._dropped(cause, given_up)

    def finish(self, timeout_s: float) -> bool:
        """Wait until all jobs that there are now have been done; false if that took too long."""
        done = threading.Event()
        self.call(done.set)
        return done.wait(timeout_s)

    def close(self, timeout_s: float) -> None:
        """End the thread after all jobs that wait, held frames among them; give up after `timeout_s`."""
        with self._changed:
            self._holding = False
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)

    def _put(self, job: _Job) -> None:
        pushed_out = 0
        with self._changed:
            if self._closing:
                return
            if job.is_frame:
                most = self.limit * self.messages_per_frame
                pushed_out = self._push_out(most, job.since_s) if self._frames_waiting >= most else 0
                self._frames_waiting += 1
            self._jobs.append(job)
            self._changed.notify_all()
        if pushed_out:
            self._dropped("queue", pushed_out)

    def _push_out(self, most: int, now_s: float) -> int:
        """Make room for a frame if that has to be, and then for all but `most`; how many were given up for it."""
        frames = [job for job in self._jobs if job.is_frame]
        patient = now_s >= self._calm_from_s and now_s - frames[0].since_s < self._patience_s
        if patient and len(frames) < MOST_WAITING:
            return 0
        given_up = frames[:len(frames) - most + 1]
        for job in given_up:
            self._jobs.remove(job)
        self._frames_waiting -= len(given_up)
        self._calm_from_s = now_s + CALM_S
        return len(given_up)

    def _take(self) -> _Job | None:
        """The next job that may run, or None when closed and nothing is left."""
        with self._changed:
            while True:
                for job in self._jobs:
                    if not (job.is_frame and self._holding):
                        self._jobs.remove(job)
                        self._frames_waiting -= job.is_frame
                        return job
                if self._closing:
                    return None
                self._changed.wait()

    def _run(self) -> None:
        while (job := self._take()) is not None:
            try:
                job.function(*job.args)
            except Exception as error:      # whatever a frame does to a job, the next frame is served
                self._failed(error, job.is_frame)
