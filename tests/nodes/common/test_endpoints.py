"""Missed messages are counted from the numbers of those that came."""

import pytest

from srt3d_ros.nodes.common.endpoints import SequenceLoss


@pytest.mark.parametrize("numbers, missed", [
    ([1, 2, 3], [0, 0, 0]),
    ([7, 8], [0, 0]),                       # what came before we listened was not for us
    ([1, 3, 7], [0, 1, 3]),
    ([5, 6, 1, 3], [0, 0, 0, 1]),           # the publisher started again
    ([None, None], [0, 0]),
])
def test_gaps_between_the_numbers_of_one_publisher_are_misses(numbers, missed):
    for publishers, counted in ((1, missed), (2, [0] * len(missed))):       # numbers of two look alike
        gaps = SequenceLoss(lambda: publishers)
        assert [gaps.missed_before(number) for number in numbers] == counted
