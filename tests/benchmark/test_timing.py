"""Works are timed in turns, as often as is asked for, and on a GPU until it is done; their peak memory is measured."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from srt3d_ros.benchmark import timing
from srt3d_ros.benchmark.timing import Work, in_turns, peak_memory

MB = 10**6


@pytest.fixture
def calls():
    return []


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The time goes on only while a work is done."""
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr(timing, "time", clock)
    return clock


def work(calls, name, seconds=0.0, device="cpu"):
    def call():
        calls.append(name)
        timing.time.now += seconds
    return Work(call, name, {"device": device})


def test_all_are_timed_once_before_any_is_timed_again(calls, bar):
    works = [work(calls, "one", 0.01), work(calls, "other", 0.05)]
    in_turns(works, 3, bar)
    assert calls == ["one", "other"] * 4 == bar.shown               # the first round allocates what later ones use
    for line, ms in zip((work.line() for work in works), (10, 50)):
        assert line["repeats"] == 3 and line["ms"] == {"min": ms, "median": ms, "max": ms}
        assert line["device"] == "cpu" and "growth_bytes" in line and "device_peak_bytes" not in line
    works[0].seconds = [0.003, 0.001, 0.008123456]
    assert works[0].line()["ms"] == {"min": 1.0, "median": 3.0, "max": 8.1235}


def test_a_work_that_takes_long_is_not_repeated(calls, bar):
    works = [work(calls, "very slow", 0.5), work(calls, "slow", 0.02), work(calls, "fast", 0.001)]
    in_turns(works, 4, bar, limit_s=0.03)
    assert [len(work.seconds) for work in works] == [1, 2, 4] and calls.count("very slow") == 1


def test_the_time_on_a_gpu_is_until_it_is_done(calls, bar, monkeypatch):
    monkeypatch.setattr(torch.cuda, "synchronize", lambda: calls.append("done"))
    monkeypatch.setattr(torch.cuda, "reset_peak_memory_stats", lambda: calls.append("reset"))
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda: 12_345)
    monkeypatch.setattr(timing, "WAKE_S", 0.0)
    on_gpu = work(calls, "a", device="cuda")
    in_turns([on_gpu], 1, bar)
    assert calls == ["reset", *["done", "a", "done"] * 2]
    assert on_gpu.line()["device_peak_bytes"] == 12_345


def test_a_gpu_is_awake_when_it_is_timed(calls, monkeypatch):
    monkeypatch.setattr(timing, "synchronise", lambda device: None)
    timing.timed(work(calls, "a", 0.01, device="cuda"))
    assert len(calls) in (6, 7)                 # five or, by rounding, six to wake it, and the one that counts


def test_the_peak_of_memory_counts_what_is_freed_again_but_no_earlier_peak():
    np.ones(50 * MB)
    _, memory = peak_memory(lambda: len(np.ones(10 * MB)))
    assert 79 * MB < memory["growth_bytes"] < 120 * MB and memory["process_peak_bytes"] > memory["growth_bytes"]


def test_without_the_kernels_count_there_is_no_peak(tmp_path, monkeypatch):
    monkeypatch.setattr(timing, "PROCESS", tmp_path / "absent")
    assert peak_memory(lambda: 7) == (7, {})
