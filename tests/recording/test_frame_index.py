"""Frames of a recording are numbered from 0 as their stamps come, and the rate of clouds is that of their stamps."""

import pytest

from srt3d_ros.recording.frame_index import STAMPS_KEPT, FrameIndex


def test_frames_count_up_by_their_stamps_and_an_old_one_is_forgotten():
    frames = FrameIndex()
    assert [frames[stamp].number for stamp in (10, 30, 20, 30)] == [0, 1, 2, 1]
    assert frames.newest.stamp_ns == 30
    for stamp in range(100, 100 + STAMPS_KEPT):
        last = frames[stamp]
    assert last.number == 2 + STAMPS_KEPT and frames[10].number == last.number + 1


def test_the_rate_is_that_of_the_last_clouds():
    frames = FrameIndex()
    rates = [frames.cloud_came(frames[stamp * 10**8]) for stamp in range(20)]
    assert rates[0] is None and rates[1:] == pytest.approx([10.0] * 19)
