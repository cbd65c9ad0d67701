"""The worker thread: newest frame first, everything else in order, every dropped frame counted."""

import threading
from types import SimpleNamespace

import pytest

from srt3d_ros.nodes.common import worker as module
from srt3d_ros.nodes.common.worker import RECOVERY_S, Worker


class Probe:
    """A worker whose first job waits until `go`, and what came of the jobs."""

    def __init__(self, limit: int, catch_up_s: float = 0.0):
        self.done, self.failed, self.dropped = [], [], []
        self.worker = Worker(limit, lambda *failure: self.failed.append(failure), self._drop, catch_up_s)
        self.busy, self.go = threading.Event(), threading.Event()
        self.block()

    def block(self):
        """Have the worker wait for `go`."""
        self.busy.clear()
        self.go.clear()
        self.worker.call(self._wait)
        self.busy.wait(60)

    def offer(self, *frames):
        for frame in frames:
            self.worker.offer(self.done.append, frame)

    def finish(self):
        self.go.set()
        self.worker.close(60)
        return self.done

    def _drop(self, cause, frames):
        self.dropped.extend([cause] * frames)

    def _wait(self):
        self.busy.set()
        self.go.wait(60)


@pytest.fixture
def probe():
    probes = []

    def probe(limit, catch_up_s=0.0):
        probes.append(Probe(limit, catch_up_s))
        return probes[-1]

    yield probe
    for made in probes:
        made.finish()


@pytest.mark.parametrize("limit, messages_per_frame, offered, kept", [
    (1, 1, 3, [2]), (3, 1, 5, [2, 3, 4]), (1, 3, 8, [5, 6, 7])])
def test_a_queue_keeps_the_messages_of_its_newest_frames_in_order(probe, limit, messages_per_frame, offered, kept):
    queue = probe(limit)
    queue.worker.messages_per_frame = messages_per_frame
    queue.worker.call(queue.done.append, "sensor")
    queue.offer(*range(offered))
    assert queue.finish() == ["sensor", *kept] and queue.dropped == ["queue"] * (offered - len(kept))


def test_held_frames_wait_in_order_for_another_job_or_are_dropped_for_the_cause_that_holds_them(probe):
    holding = probe(limit=3)
    holding.worker.hold_frames("no_sensor")
    holding.offer(0, 1, 2, 3)
    holding.worker.call(holding.done.append, "sensor")
    holding.worker.call(holding.worker.release_frames)
    last = threading.Event()
    holding.worker.call(last.set)
    holding.go.set()
    assert last.wait(60)
    assert holding.finish() == ["sensor", 1, 2, 3] and holding.dropped == ["no_sensor"]


def test_a_job_that_fails_is_reported_and_the_next_one_runs(probe):
    failing = probe(limit=8)
    failing.worker.offer(lambda: 1 / 0)
    failing.worker.call(lambda: {}["key"])
    failing.offer("next")
    assert failing.finish() == ["next"]
    failures = [(type(error), frames) for error, frames in failing.failed]
    assert failures == [(ZeroDivisionError, 1), (KeyError, 0)]


def test_dropped_frames_are_counted_and_other_jobs_stay(probe):
    queue = probe(limit=2)
    queue.offer(0, 1, 2)
    queue.worker.call(queue.done.append, "sensor")
    assert queue.dropped == ["queue"]
    queue.worker.clear("inactive")
    queue.finish()
    queue.offer(3)
    assert queue.dropped == ["queue", "inactive", "inactive", "shutdown"]
    assert queue.done == ["sensor"]


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now_s=1000.0, monotonic=lambda: clock.now_s)
    monkeypatch.setattr(module, "time", clock)
    return clock


def test_frames_wait_while_a_busy_machine_catches_up_and_only_the_newest_if_it_does_not(probe, clock):
    behind = probe(limit=1, catch_up_s=0.25)
    for k in range(10):
        behind.offer(k)
        clock.now_s += 0.02
    assert behind.dropped == []                 # the oldest waits for 0.2 s
    clock.now_s += 0.06
    behind.offer(10)
    assert len(behind.dropped) == 10
    for k in range(11, 15):                     # overloaded until nothing was dropped for RECOVERY_S
        clock.now_s += 0.9 * RECOVERY_S
        behind.offer(k)
        assert len(behind.dropped) == k
    behind.go.set()
    assert behind.worker.finish(60) and behind.done == [14]
    behind.block()
    clock.now_s += 1.01 * RECOVERY_S
    behind.offer(*range(15, 18))
    assert behind.finish() == [14, 15, 16, 17] and len(behind.dropped) == 14
