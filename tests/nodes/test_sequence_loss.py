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
    assert gaps.numbered == (numbers[0] is not None)


def test_two_that_speak_at_rates_of_their_own_are_not_mistaken_either():
    gaps = SequenceLoss(lambda: 2)
    numbers = []
    for k in range(1, 300):                 # the second speaks once for ten messages of the first, from afar
        numbers += [k] if k % 10 else [k, 5_000 + k // 10]
    assert sum(map(gaps.after, numbers)) == 0
