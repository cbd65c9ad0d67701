"""Latencies: how old a node's frames are when it publishes them."""

from collections import deque

import numpy as np

KEPT = 200              # newest frames, for the percentiles
OLD_S = 2.0             # median before a warning
OTHER_CLOCK_S = 3600.0  # no queue is so long
# Warn of stamps this far ahead of the node's clock. Clocks set by NTP differ by milliseconds, but a simulated clock may
# tick at 10 Hz or, on a busy machine, more slowly.
AHEAD_S = 0.5


class Latencies:
    """The times from the stamps of the newest frames to their publication, s."""

    def __init__(self):
        self._newest_s: deque[float] = deque(maxlen=KEPT)
        self._least_s = float("inf")        # of all frames

    def add(self, latency_s: float) -> None:
        """Add a frame."""
        self._newest_s.append(latency_s)
        self._least_s = min(self._least_s, latency_s)

    def percentiles(self) -> dict[str, str]:
        """The values of a report; empty before the first frame."""
        if not self._newest_s:
            return {}
        p50_ms, p95_ms = np.percentile(self._newest_s, [50, 95]) * 1e3
        return {"latency_p50_ms": f"{p50_ms:.2f}", "latency_p95_ms": f"{p95_ms:.2f}"}

    def untimely(self, frames: int) -> str:
        """A warning if the last `frames` frames were too old or stamped ahead of the node's clock."""
        if not frames:
            return ""
        age_s = float(np.median(list(self._newest_s)[-frames:]))
        if age_s > OLD_S:
            cause = "behind" if self._least_s < OLD_S else "behind, or stamped by another clock"
            cause = "stamped by another clock" if age_s > OTHER_CLOCK_S else cause
            return f"frames are {age_s:.1f} s old: {cause}"
        if age_s < -AHEAD_S:
            return f"frames are stamped {-age_s:.1f} s ahead of this node's clock: tf cannot place them"
        return ""
