"""Missed messages are counted from the numbers of those that came."""

import pytest

from srt3d_ros.nodes.base import SequenceLoss


@pytest.mark.parametrize("numbers, missed", [
    ([1, 2, 3], [0, 0, 0]),
    ([7, 8], [0, 0]),                       # what came before we listened was not for us
    ([1, 3, 7], [0, 1, 3]),
    ([5, 6, 1, 3], [0, 0, 0, 1]),           # the publisher started again
    ([None, None], [0, 0]),
])
def test_gaps_between_numbers_are_misses(numbers, missed):
    gaps = SequenceLoss(lambda: 1)
    assert [gaps.after(number) for number in numbers] == missed


def test_of_two_publishers_whose_numbers_look_alike_nothing_is_counted():
    gaps = SequenceLoss(lambda: 2)
    assert [gaps.after(number) for number in (1, 5, 2, 9)] == [0, 0, 0, 0]
