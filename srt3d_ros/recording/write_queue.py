"""WriteQueue: what waits to be recorded. The memory of clouds and images is bounded; the oldest are dropped first."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

_MOST_WAITING = 100_000     # writes of all kinds; only scalars logged to a disk that hangs come near it


@dataclass(frozen=True, eq=False)
class Write:
    """A pending write: `size` bytes of a cloud or an image, or 0 if it is small."""

    run: Callable[[], None]
    size: int = 0


class WriteQueue:
    """A queue from any number of threads to one.

    Args:
        most_bytes: of clouds and images that may wait; one always may. `dropped` counts those that are not written.
    """

    def __init__(self, most_bytes: int):
        self.dropped = 0
        self._most_bytes, self._bytes = most_bytes, 0
        self._writes: deque[Write] = deque()
        self._changed, self._closed = threading.Condition(), False

    def put(self, write: Write) -> None:
        """Append a write; after `close` it is dropped."""
        with self._changed:
            if self._closed or len(self._writes) >= _MOST_WAITING:
                self.dropped += write.size > 0
                return
            while write.size and self._bytes and self._bytes + write.size > self._most_bytes:
                oldest = next(k for k, waiting in enumerate(self._writes) if waiting.size)
                self._bytes -= self._writes[oldest].size
                del self._writes[oldest]
                self.dropped += 1
            self._writes.append(write)
            self._bytes += write.size
            self._changed.notify()

    def take(self, timeout_s: float) -> Write | None:
        """Wait for the oldest write and remove it; None after `timeout_s` seconds, or when closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._writes or self._closed, timeout_s)
            if not self._writes:
                return None
            write = self._writes.popleft()
            self._bytes -= write.size
            return write

    def close(self, drop: bool = False) -> None:
        """Accept no further writes; those that wait can still be taken, unless they are to be dropped, too."""
        with self._changed:
            self._closed = True
            if drop:
                self.dropped += sum(write.size > 0 for write in self._writes)
                self._writes.clear()
            self._changed.notify()

    @property
    def at_end(self) -> bool:
        """True once closed and empty."""
        with self._changed:
            return self._closed and not self._writes
