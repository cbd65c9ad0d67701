"""Counts: how many packets and photons came, were published, and were dropped, by cause."""

import threading
from collections import Counter


class Counts:
    """Totals since the start; may be counted from any thread."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self.totals: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()              # packets or frames, by cause
        self.photons_dropped: Counter[str] = Counter()

    def count(self, **amounts: int) -> None:
        """Add to totals of these names."""
        with self._lock:
            self.totals.update(amounts)

    def drop(self, cause: str, frames: int = 1, photons: int = 0) -> None:
        """Count frames that were dropped for `cause`, and their photons."""
        with self._lock:
            self.dropped[cause] += frames
            self.photons_dropped[cause] += photons
