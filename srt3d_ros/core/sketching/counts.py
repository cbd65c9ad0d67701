"""Counts: what came, what was published, and what was dropped for which cause."""

import threading
from collections import Counter


class Counts:
    """Totals that count from the start and never fall, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self.totals: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()              # packets, or frames where nothing smaller comes, by cause
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
