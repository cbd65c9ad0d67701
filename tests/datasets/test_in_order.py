"""Items by number, of what can only be read one after the other."""

import pytest

from srt3d_ros.datasets.in_order import InOrder


def test_items_are_read_anew_only_for_a_smaller_number():
    read = []

    def start():
        for item in "abcde":
            read.append(item)
            yield item

    items = InOrder(start)
    assert [items[k] for k in (1, 2, 4, 0, 3)] == list("bcead") and "".join(read) == "abcdeabcd"
    with pytest.raises(IndexError):
        items[5]
    assert items[1] == "b"
