"""Items that can only be read one after the other, by their number."""

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Generic, TypeVar

Item = TypeVar("Item")


class InOrder(Generic[Item]):
    """Items by their number: cheap if that grows from call to call, else they are read anew from the first.

    Args:
        start: gives them from the first on, as often as it is called.
    """

    def __init__(self, start: Callable[[], Iterator[Item]]):
        self._start, self._rest, self._next = start, None, 0

    def __getitem__(self, number: int) -> Item:
        """The item of this number; IndexError if they end before."""
        if self._rest is None or number < self._next:
            self._rest, self._next = self._start(), 0
        rest, self._rest = self._rest, None         # which is of no use after an error
        for item in islice(rest, number - self._next, None):
            self._rest, self._next = rest, number + 1
            return item
        raise IndexError(number)
