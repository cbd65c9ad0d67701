"""The worker thread: newest frame first, everything else in order, nothing hidden."""

import threading

import pytest

from srt3d_ros.nodes import worker as module
from srt3d_ros.nodes.worker import CALM_S, MOST_WAITING, Worker


class Probe:
    """A worker whose first job waits until `go`, and what came of the jobs."""

    def __init__(self, limit: int, patience_s: float = 0.0):
        self.done, self.failed, self.dropped = [], [], []
        self.worker = Worker(limit, lambda error, frames, photons: self.failed.append((error, frames, photons)),
                             self._drop, patience_s)
        self.photons_dropped = 0
        self.busy, self.go = threading.Event(), threading.Event()
        self.worker.call(self._block)
        self.busy.wait()

    def _drop(self, cause, frames, photons):
        self.dropped.extend([cause] * frames)
        self.photons_dropped += photons

    def _block(self):
        self.busy.set()
        self.go.wait()

    def finish(self):
        self.go.set()
        self.worker.close(60)


@pytest.fixture
def probe():
    probes = []

    def probe(limit, patience_s=0.0):
        probes.append(Probe(limit, patience_s))
        return probes[-1]

    yield probe
    for made in probes:
        made.finish()


def test_the_newest_frame_pushes_out_the_waiting_one_but_no_other_job(probe):
    newest = probe(limit=1)
    newest.worker.offer(newest.done.append, "frame 0")
    newest.worker.call(newest.done.append, "sensor")
    newest.worker.offer(newest.done.append, "frame 1")
    newest.worker.offer(newest.done.append, "frame 2")
    newest.finish()
    assert newest.done == ["sensor", "frame 2"] and newest.dropped == ["queue", "queue"]


def test_a_queue_keeps_frames_in_order_up_to_its_limit(probe):
    queue = probe(limit=3)
    for k in range(5):
        queue.worker.offer(queue.done.append, k)
    queue.finish()
    assert queue.done == [2, 3, 4] and queue.dropped == ["queue", "queue"]


def test_held_frames_wait_for_another_job_and_keep_their_order(probe):
    holding = probe(limit=8)
    holding.worker.hold_frames()
    for k in range(3):
        holding.worker.offer(holding.done.append, k)
    holding.worker.call(holding.done.append, "sensor")
    holding.worker.call(holding.worker.release_frames)
    last = threading.Event()
    holding.worker.offer(last.set)
    holding.go.set()
    assert last.wait(60)
    assert holding.done == ["sensor", 0, 1, 2]


def test_a_job_that_fails_is_told_and_the_next_one_served(probe):
    failing = probe(limit=8)
    failing.worker.offer(lambda: 1 / 0, photons=7)
    failing.worker.call(lambda: {}["key"])
    failing.worker.offer(failing.done.append, "next")
    failing.finish()
    assert failing.done == ["next"]
    told = [(type(error), frames, photons) for error, frames, photons in failing.failed]
    assert told == [(ZeroDivisionError, 1, 7), (KeyError, 0, 0)]


def test_frames_that_wait_are_given_up_and_counted_when_it_is_cleared_and_other_jobs_stay(probe):
    clearing = probe(limit=8)
    for k in range(3):
        clearing.worker.offer(clearing.done.append, k)
    clearing.worker.call(clearing.done.append, "sensor")
    clearing.worker.clear("inactive")
    clearing.finish()
    assert clearing.done == ["sensor"] and clearing.dropped == ["inactive"] * 3


def test_frames_that_wait_are_known_with_their_photons_and_so_are_those_that_are_given_up(probe):
    queue = probe(limit=2)
    for photons in (1, 10, 100):
        queue.worker.offer(queue.done.append, photons, photons=photons)
    assert (queue.worker.waiting, queue.photons_dropped, queue.worker.busy) == ((2, 110), 1, True)
    queue.worker.clear("inactive")
    assert (queue.worker.waiting, queue.photons_dropped) == ((0, 0), 111)
    queue.finish()
    queue.worker.offer(queue.done.append, 1000, photons=1000)
    assert queue.dropped == ["queue", "inactive", "inactive", "shutdown"] and queue.photons_dropped == 1111
    assert not queue.worker.busy and queue.done == []


def test_the_frame_in_hand_of_a_worker_that_does_not_end_is_given_up_with_those_that_wait(probe):
    stuck = probe(limit=8)
    begun = threading.Event()
    stuck.worker.offer(lambda: (begun.set(), stuck.busy.clear(), stuck.go.clear(), stuck._block()), photons=5)
    stuck.worker.offer(stuck.done.append, "waits", photons=6)
    stuck.go.set()
    assert begun.wait(60)
    stuck.worker.close(0.0)
    assert (stuck.dropped, stuck.photons_dropped, stuck.done) == (["shutdown"] * 2, 11, [])


class Clock:
    now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def test_frames_wait_while_a_busy_machine_catches_up_and_only_the_newest_if_it_does_not(probe, clock):
    patient = probe(limit=1, patience_s=0.25)
    for k in range(10):
        patient.worker.offer(patient.done.append, k)
        clock.now_s += 0.02
    assert patient.dropped == []                # the oldest waits for 0.2 s
    clock.now_s += 0.06
    patient.worker.offer(patient.done.append, 10)
    assert len(patient.dropped) == 10
    for k in range(11, 15):                     # overloaded: no patience until there was nothing to give up for CALM_S
        clock.now_s += 0.9 * CALM_S
        patient.worker.offer(patient.done.append, k)
        assert len(patient.dropped) == k
    patient.finish()
    assert patient.done == [14]


def test_patience_comes_back_after_a_calm_time_without_drops(probe, clock):
    patient = probe(limit=1, patience_s=0.25)
    patient.worker.offer(patient.done.append, 0)
    clock.now_s += 0.3
    patient.worker.offer(patient.done.append, 1)
    assert patient.dropped == ["queue"]
    patient.go.set()
    assert patient.worker.finish(60)
    patient.busy.clear()
    patient.go.clear()
    patient.worker.call(patient._block)
    patient.busy.wait()
    clock.now_s += 1.01 * CALM_S
    for k in range(2, 6):
        patient.worker.offer(patient.done.append, k)
    patient.finish()
    assert patient.done == [1, 2, 3, 4, 5] and patient.dropped == ["queue"]


def test_the_messages_of_one_frame_do_not_push_each_other_out(probe):
    newest = probe(limit=1)
    newest.worker.messages_per_frame = 3
    for k in range(8):
        newest.worker.offer(newest.done.append, k)
    newest.finish()
    assert newest.done == [5, 6, 7] and newest.dropped == ["queue"] * 5


def test_however_patient_a_queue_stays_bounded(probe, clock):
    patient = probe(limit=2, patience_s=1e9)
    for k in range(MOST_WAITING + 1):
        patient.worker.offer(patient.done.append, k)
    patient.finish()
    assert patient.done == [MOST_WAITING - 1, MOST_WAITING] and len(patient.dropped) == MOST_WAITING - 1
