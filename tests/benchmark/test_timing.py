"""Works are timed in turns, as often as is asked for, and on a GPU until it is done."""

from types import SimpleNamespace

import pytest

from srt3d_ros.benchmark import timing
from srt3d_ros.benchmark.timing import Work, in_turns, runs, spread


@pytest.fixture
def calls():
    return []


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The time goes on only while a work is done."""
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr(timing, "time", clock)
    return clock


def work(calls, name, seconds=0.0, **options):
    def call():
        calls.append(name)
        timing.time.now += seconds
    return Work(call, options.pop("device", "cpu"), name, **options)


def test_all_are_timed_once_before_any_is_timed_again(calls, bar):
    timings = in_turns({name: work(calls, name) for name in "ab"}, 3, bar)
    assert calls == list("ab" * 4)                                      # the first round settles what later ones use
    assert [len(timing.seconds) for timing in timings.values()] == [3, 3]
    assert bar.n == runs(2, 3) and bar.said[:2] == ["a", "b"]


def test_a_work_that_settles_nothing_is_timed_from_the_first(calls, bar):
    timings = in_turns({"a": work(calls, "a", settles=False)}, 3, bar)
    assert calls == list("aaa") and len(timings["a"].seconds) == 3 and bar.n == runs(1, 3)


def test_impatience_ends_the_repeats_of_the_slow_one_only(calls, bar):
    works = {"slow": work(calls, "slow", 0.02, settles=False), "fast": work(calls, "fast"),
             "settling": work(calls, "settling", 0.02)}
    timings = in_turns(works, 4, bar, patience_s=0.01)
    assert [len(timings[name].seconds) for name in works] == [1, 4, 1]
    assert bar.n == runs(3, 4)


def test_what_is_told_of_a_work(calls, bar):
    figures = in_turns({"a": work(calls, "a", 0.01)}, 3, bar)["a"].figures()
    assert figures["repeats"] == 3 and figures["ms"] == {"min": 10, "median": 10, "max": 10}
    assert "device_peak_bytes" not in figures


def test_the_time_of_several_frames_is_told_of_one(calls, bar):
    timings = in_turns({"one": work(calls, "a", 0.05), "of five": work(calls, "a", 0.05, frames=5)}, 1, bar)
    assert [timing.median_ms for timing in timings.values()] == pytest.approx([50, 10])


def test_min_median_max():
    assert spread([3.0, 1.0, 8.123456]) == {"min": 1.0, "median": 3.0, "max": 8.1235}


def test_the_time_on_a_gpu_is_until_it_is_done(calls, bar, monkeypatch):
    import torch
    monkeypatch.setattr(torch.cuda, "synchronize", lambda: calls.append("done"))
    monkeypatch.setattr(torch.cuda, "reset_peak_memory_stats", lambda: calls.append("reset"))
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda: 12_345)
    monkeypatch.setattr(timing, "WAKE_S", 0.0)
    timings = in_turns({"a": work(calls, "a", device="cuda")}, 1, bar)
    assert calls == ["reset", *["done", "a", "done"] * 2]
    assert timings["a"].figures()["device_peak_bytes"] == 12_345


def test_a_gpu_is_awake_when_it_is_timed(calls, monkeypatch):
    monkeypatch.setattr(timing, "synchronise", lambda device: None)
    monkeypatch.setattr(timing, "WAKE_S", 0.05)
    timing.timed(work(calls, "a", 0.01, device="cuda"))
    assert len(calls) in (6, 7)                 # five or, by rounding, six to wake it, and the one that counts
    calls.clear()
    timing.timed(work(calls, "a", 0.01))
    assert len(calls) == 1
