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
    photons: int = 0
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
        failed: called with (exception, frames, photons) when a job raises, 1 frame or none; the worker goes on.
        dropped: called with (cause, frames, photons) for frames that are given up: "queue" if newer ones push them out.
        done: called after each job, when nothing is in hand.

    Attributes:
        lock: held while frames are put, taken or given up; who counts frames beside that holds it too.
    """

    def __init__(self, limit: int, failed: Callable[[Exception, int, int], None],
                 dropped: Callable[[str, int, int], None], patience_s: float = 0.0,
                 done: Callable[[], None] = lambda: None):
        self.limit, self._failed, self._dropped, self._patience_s = limit, failed, dropped, patience_s
        self._done = done
        self.messages_per_frame = 1
        self._calm_from_s = 0.0
        self._jobs: deque[_Job] = deque()
        self._frames_waiting = self._photons_waiting = 0
        self._in_hand: _Job | None = None
        self._holding = False
        self._closing = False
        self.lock = self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def call(self, function: Callable, *args) -> None:
        """Run function(*args) after what is already waiting."""
        self._put(_Job(function, args, is_frame=False))

    def offer(self, function: Callable, *args, photons: int = 0) -> None:
        """Run function(*args) for a frame of so many photons, unless newer frames push it out first."""
        self._put(_Job(function, args, is_frame=True, photons=photons))

    @property
    def busy(self) -> bool:
        """Whether a job is in hand."""
        return self._in_hand is not None

    @property
    def waiting(self) -> tuple[int, int]:
        """Frames that wait, and their photons."""
        return self._frames_waiting, self._photons_waiting

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
            self._give_up(cause, [job for job in self._jobs if job.is_frame])

    def finish(self, timeout_s: float) -> bool:
        """Wait until all jobs that there are now have been done; false if that took too long."""
        done = threading.Event()
        self.call(done.set)
        return done.wait(timeout_s)

    def close(self, timeout_s: float) -> None:
        """End the thread after all jobs that wait, held frames among them; after `timeout_s`, give them up."""
        with self._changed:
            self._holding = False
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        with self._changed:
            self._give_up("shutdown", [job for job in self._jobs if job.is_frame])
            if self._in_hand is not None and self._in_hand.is_frame:
                self._dropped("shutdown", 1, self._in_hand.photons)
            self._in_hand = None

    def _put(self, job: _Job) -> None:
        with self._changed:
            if self._closing:
                if job.is_frame:
                    self._dropped("shutdown", 1, job.photons)
                return
            if job.is_frame:
                most = self.limit * self.messages_per_frame
                if self._frames_waiting >= most:
                    self._push_out(most, job.since_s)
                self._count_waiting(job, 1)
            self._jobs.append(job)
            self._changed.notify_all()

    def _push_out(self, most: int, now_s: float) -> None:
        """Make room for a frame if that has to be, and then for all but `most`."""
        frames = [job for job in self._jobs if job.is_frame]
        patient = now_s >= self._calm_from_s and now_s - frames[0].since_s < self._patience_s
        if patient and len(frames) < MOST_WAITING:
            return
        self._give_up("queue", frames[:len(frames) - most + 1])
        self._calm_from_s = now_s + CALM_S

    def _give_up(self, cause: str, frames: list[_Job]) -> None:
        for job in frames:
            self._jobs.remove(job)
            self._count_waiting(job, -1)
        if frames:
            self._dropped(cause, len(frames), sum(job.photons for job in frames))

    def _count_waiting(self, job: _Job, sign: int) -> None:
        if job.is_frame:
            self._frames_waiting += sign
            self._photons_waiting += sign * job.photons

    def _take(self) -> _Job | None:
        """The next job that may run, or None when closed and nothing is left."""
        with self._changed:
            while True:
                for job in self._jobs:
                    if not (job.is_frame and self._holding):
                        self._jobs.remove(job)
                        self._count_waiting(job, -1)
                        self._in_hand = job
                        return job
                if self._closing:
                    return None
                self._changed.wait()

    def _run(self) -> None:
        while (job := self._take()) is not None:
            try:
                job.function(*job.args)
            except Exception as error:      # whatever a frame does to a job, the next frame is served
                self._failed(error, int(job.is_frame), job.photons)
            self._in_hand = None
            self._done()
