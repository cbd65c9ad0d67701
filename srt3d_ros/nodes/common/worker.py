"""Worker: the thread that does a node's work, so that the executor never blocks."""

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

NEWEST_ONLY = 1
CATCH_UP_S = 1.0        # queue all frames while the oldest has waited for less: a busy machine then loses none
RECOVERY_S = 1.0        # without a dropped frame, after which the worker may queue all frames again
MAX_WAITING = 64        # messages queued while the worker catches up: bounds the memory


class Dropped(Exception):
    """Raised by a job that drops its frame without an error; `cause` is counted, `reason` is logged."""

    def __init__(self, cause: str, reason: str):
        super().__init__(reason)
        self.cause = cause


@dataclass(frozen=True, eq=False)
class _Job:
    function: Callable
    args: tuple
    frames: int         # 1, or 0 for a job that processes no frame
    since_s: float = field(default_factory=lambda: time.monotonic())


class Worker:
    """Runs jobs in order of arrival, and drops the oldest frames when it cannot keep up. Other jobs are never dropped.

    The queue keeps all frames until the oldest has waited for `catch_up_s`. From then on it keeps only the newest
    `limit`, which bounds the latency, until no frame has been dropped for RECOVERY_S.

    Args:
        limit: frames that may wait. Every message is counted as a frame, but for this limit, which is multiplied by
            `messages_per_frame`.
        failed: called with (exception, frames) when a job raises, frames 1 or 0; the worker goes on.
        dropped: called with (cause, frames) for dropped frames; the cause is "queue" or the one given to `hold_frames`.
    """

    def __init__(self, limit: int, failed: Callable[[Exception, int], None],
                 dropped: Callable[[str, int], None], catch_up_s: float = CATCH_UP_S):
        self.limit, self._failed, self._dropped, self._catch_up_s = limit, failed, dropped, catch_up_s
        self.messages_per_frame = 1
        self._recovered_from_s = 0.0
        self._jobs: deque[_Job] = deque()
        self._current: _Job | None = None
        self._waiting_cause = ""        # why no frame is processed; empty if frames are
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def call(self, function: Callable, *args: object) -> None:
        """Run function(*args) after the jobs in the queue."""
        self._put(_Job(function, args, frames=0))

    def offer(self, function: Callable, *args: object) -> None:
        """Run function(*args) for a frame, unless the frame is dropped first."""
        self._put(_Job(function, args, frames=1))

    def hold_frames(self, cause: str) -> None:
        """Keep frames in the queue until `release_frames`, and run other jobs; frames are dropped for `cause`."""
        with self._changed:
            self._waiting_cause = cause

    def release_frames(self) -> None:
        """Process frames again."""
        with self._changed:
            self._waiting_cause = ""
            self._changed.notify_all()

    def clear(self, cause: str) -> int:
        """Drop the frames in the queue and return their number; other jobs stay."""
        with self._changed:
            frames = [job for job in self._jobs if job.frames]
            self._drop(cause, frames)
            return len(frames)

    def finish(self, timeout_s: float) -> bool:
        """Wait until all jobs in the queue are done; False after a timeout."""
        done = threading.Event()
        self.call(done.set)
        return done.wait(timeout_s)

    def close(self, timeout_s: float) -> bool:
        """End the thread after all jobs, also of held frames; after `timeout_s`, drop the rest and return False."""
        with self._changed:
            self._waiting_cause = ""
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        self.clear("shutdown")
        with self._changed:
            if self._current is not None and self._current.frames:
                self._dropped("shutdown", 1)
            self._current = None
        return not self._thread.is_alive()

    def _put(self, job: _Job) -> None:
        with self._changed:
            if self._closing:
                if job.frames:
                    self._dropped("shutdown", 1)
                return
            if job.frames:
                self._make_room(job.since_s)
            self._jobs.append(job)
            self._changed.notify_all()

    def _make_room(self, now_s: float) -> None:
        """Drop the oldest frames so that one more may wait, unless the worker may still catch up."""
        frames, most = [job for job in self._jobs if job.frames], self.limit * self.messages_per_frame
        if len(frames) < most:
            return
        may_catch_up = now_s >= self._recovered_from_s and now_s - frames[0].since_s < self._catch_up_s
        if may_catch_up and len(frames) < MAX_WAITING:
            return
        self._drop(self._waiting_cause or "queue", frames[:len(frames) - most + 1])
        self._recovered_from_s = now_s + RECOVERY_S

    def _drop(self, cause: str, frames: list[_Job]) -> None:
        for job in frames:
            self._jobs.remove(job)
        if frames:
            self._dropped(cause, len(frames))

    def _take(self) -> _Job | None:
        """Wait for the next job that may run; None when the worker is closed and no job is left."""
        with self._changed:
            while True:
                job = next((job for job in self._jobs if not (job.frames and self._waiting_cause)), None)
                if job is not None:
                    self._jobs.remove(job)
                    self._current = job
                if job is not None or self._closing:
                    return job
                self._changed.wait()

    def _run(self) -> None:
        while (job := self._take()) is not None:
            try:
                job.function(*job.args)
            except Exception as error:      # the next frame must be processed whatever this one raised
                try:
                    self._failed(error, job.frames)
                except Exception:
                    traceback.print_exc()
            with self._changed:
                self._current = None
