"""The peak is that of the time between, and counts what is freed before its end."""

import numpy as np

from srt3d_ros.benchmark.memory import PeakMemory

MB = 10**6


def test_what_is_freed_again_counts():
    with PeakMemory() as memory:
        np.ones(10 * MB)
    assert 79 * MB < memory.growth_bytes < 120 * MB and memory.process_bytes > memory.growth_bytes


def test_an_earlier_peak_does_not_count():
    np.ones(20 * MB)
    with PeakMemory() as memory:
        pass
    assert memory.growth_bytes < 40 * MB


def test_where_the_kernel_does_not_tell_nothing_is_told(tmp_path):
    with PeakMemory(tmp_path / "absent") as memory:
        pass
    assert memory.growth_bytes is None and memory.process_bytes is None
