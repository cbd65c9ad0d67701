"""Answers: which messages of a lossless player clouds have answered, and whether more may be sent."""

from collections import deque

from srt3d_ros.nodes.base import QUEUE_DEPTH

MORE_BYTES = 64 << 20       # unanswered, beyond which silence makes no room: they wait in memory


class Answers:
    """Clouds come in the order of frames, and answer all messages up to their stamps.

    Of a frame of several messages, a cloud has the stamp of any: those behind it stay unanswered until the next cloud,
    as do those of a frame that is not complete. So two frames are always let through.

    Args:
        in_flight: messages that may be unanswered.
        per_frame: messages of a frame; 1 if it is not known, for the answers show it.
    """

    def __init__(self, in_flight: int, per_frame: int):
        self._in_flight, self.per_frame = in_flight, per_frame
        self._stamps: deque[tuple[int, int]] = deque()      # and sizes
        self.clear()

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def has_room(self) -> bool:
        """Whether another message may be sent."""
        two_frames = 2 * self.per_frame if self.per_frame > 1 else 1
        return len(self) < max(self._in_flight, two_frames) + self._more

    @property
    def unanswerable(self) -> int:
        """The most messages to which no answer may come before others are sent: of the last and an open frame."""
        return 2 * (self.per_frame - 1)

    def sent(self, stamp_ns: int, size: int) -> None:
        """Expect an answer to a message of so many bytes."""
        self._stamps.append((stamp_ns, size))

    def answered(self, stamp_ns: int) -> None:
        """Count a cloud; the second one shows how many messages a frame has."""
        number = 0
        while self._stamps and self._stamps[0][0] <= stamp_ns:
            self._stamps.popleft()
            number += 1
        if number and self._seen:
            self.per_frame, self._more = number, 0
        self._seen = self._seen or number > 0
        self.silences = 0

    def silent(self) -> None:
        """Nothing was answered for a while: a frame may need more messages than may be in flight. Make room."""
        self.silences += 1
        if sum(size for _, size in self._stamps) < MORE_BYTES:
            self._more = min(self._more + self._in_flight, QUEUE_DEPTH)

    def clear(self) -> None:
        """Expect no answers any more."""
        self._stamps.clear()
        self._seen, self._more, self.silences = False, 0, 0
