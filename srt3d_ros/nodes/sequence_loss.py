"""Messages that a subscription missed, from the gaps in its publisher's numbering."""

from collections.abc import Callable

ONE_SPEAKS = 32         # numbers in a row that only rise: of several publishers one speaks, as after a driver's crash


class SequenceLoss:
    """Counts missed messages of one topic, whether the network lost them or newer ones pushed them out of the queue.

    The middleware's own event tells of the first kind only. While a topic has several publishers, whose numbers
    cannot be told apart, nothing is counted, unless it is plain that only one of them speaks: a process that was killed
    stays a publisher for its lease, 20 s.
    """

    def __init__(self, publishers: Callable[[], int]):
        self._publishers = publishers
        self._last: int | None = None
        self._risen = 0
        self.numbered = False       # whether this middleware numbers its messages at all

    def after(self, number: int | None) -> int:
        """How many messages were missed just before the one of this number."""
        if number is None:
            return 0
        self.numbered = True
        last, self._last = self._last, number
        if last is None or number <= last:          # lower: another publisher, or one that started again
            self._risen = 0
            return 0
        self._risen += 1
        missed = number - last - 1
        plain = self._risen > ONE_SPEAKS >= missed
        return missed if missed and (plain or self._publishers() == 1) else 0
