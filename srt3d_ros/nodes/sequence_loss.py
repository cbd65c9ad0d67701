"""Messages that a subscription missed, from the gaps in its publisher's sequence numbers."""

from collections.abc import Callable

ONE_ACTIVE = 32         # numbers that rise in a row: of several publishers one sends, as after a driver's crash


class SequenceLoss:
    """Counts missed messages of one topic, whether the network lost them or newer ones pushed them out of the queue.

    The middleware's own event reports the first kind only. While a topic has several publishers, whose numbers look
    alike, nothing is counted unless only one of them sends: a killed process stays a publisher for its lease, 20 s.
    """

    def __init__(self, publishers: Callable[[], int]):
        self._publishers = publishers
        self._last: int | None = None
        self._risen = 0
        self.numbered = False       # whether this middleware numbers its messages at all

    def after(self, number: int | None) -> int:
        """Messages missed just before the one with this number."""
        if number is None:
            return 0
        self.numbered = True
        last, self._last = self._last, number
        if last is None or number <= last:          # lower: another publisher, or one that started again
            self._risen = 0
            return 0
        self._risen += 1
        missed = number - last - 1
        one_active = self._risen > ONE_ACTIVE >= missed
        return missed if missed and (one_active or self._publishers() == 1) else 0
