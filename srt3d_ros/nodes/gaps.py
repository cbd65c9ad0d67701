"""Messages that a subscription missed, from the gaps in its publisher's numbering."""

from collections.abc import Callable


class Gaps:
    """Counts missed messages of one topic, whether the network lost them or newer ones pushed them out of the queue.

    The middleware's own event tells of the first kind only. While a topic has several publishers, whose numbers
    cannot be told apart, nothing is counted.
    """

    def __init__(self, publishers: Callable[[], int]):
        self._publishers = publishers
        self._last: int | None = None
        self.numbered = False       # whether this middleware numbers its messages at all

    def after(self, number: int | None) -> int:
        """How many messages were missed just before the one of this number."""
        if number is None:
            return 0
        self.numbered = True
        last, self._last = self._last, number
        missed = 0 if last is None else number - last - 1       # negative if the publisher started again
        return missed if missed > 0 and self._publishers() == 1 else 0
