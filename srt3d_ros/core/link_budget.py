"""LinkBudget: when a sketch may be sent and how coarsely it is rounded, so that a link or a limit keeps up with it.

A frame that may not be sent yet waits, and the next is added to it: sums of photons add, so no photon is lost. While
many have to wait, sums are rounded more coarsely, up to COARSEST; when few have for a time, finer again, a little at a
time. A coarser step is preferred: 1.6 σ instead of 0.4 halves the bytes for 2 to 9 % of depth error;
merging two frames halves them for half the rate, and for blur where the scene moves.
"""

from collections import deque

COARSEST = 1.6          # σ; 2.0 saves another 10 % of the bytes for another 2 to 5 % of depth error
COARSER = 2.0           # at once: each time saves two bits of each complex number, about a quarter of the bytes
FINER = 0.7             # little by little: about a fifth more bytes
ROOM = 0.2              # of what is sent, that the limit must leave for the next finer step
# Frames a sketch, over a second, from which on sums are rounded more coarsely. A busy machine delays acknowledgements,
# too: with ten processes on two cores, 1.1.
TOLERATED = 1.2
CALM_S = 2.0            # without more, before the next finer step and before all is well
BURST_S = 0.1           # of the limit's bytes that may be sent at once: stamps and sizes jitter
MAX_WAIT_S = 0.4        # for an acknowledgement: a reader that was killed gives none until DDS forgets it, after 20 s
# Unacknowledged sketches that keep no frame waiting, and their bytes: a link of 10 Mbit/s carries them in 26 ms. An
# acknowledgement takes up to 16 ms on any link (heartbeats: config/fastdds_network.xml): two frames of a fast sensor.
# Publishers keep eight sketches (PUBLISH_DEPTH) to be sent again.
FREE_SKETCHES, FREE_BYTES = 4, 32_768
MEAN_S = 1.0            # over which rates are taken
LIMIT, READERS = "max_mbit_s", "readers acknowledge late"


class LinkBudget:
    """Decides, sketch by sketch. All times are in seconds, of any one clock.

    Args:
        max_mbit_s: the mean of what is sent stays below, Mbit/s.
        step: the finest step, σ (messages/coded_sketch.py); 0 if sketches are not coded and merging is all.

    Attributes:
        step: that the next sketch takes, σ.
        why: what has made frames wait last, LIMIT or READERS; empty while all is well.
    """

    def __init__(self, max_mbit_s: float, step: float):
        self.settings = max_mbit_s, step
        self._s_per_byte, self._finest = 8e-6 / max_mbit_s, step
        self._coarsest = max(COARSEST, step) if step else 0.0
        self.step, self.why = step, ""
        self._paid_s = self._sent_s = self._calm_since_s = -float("inf")
        self._unacknowledged: deque[int] = deque(maxlen=FREE_SKETCHES)      # sizes
        self._held_back_by = LIMIT
        self._recent: deque[tuple[float, int, int]] = deque()       # when, bytes, frames

    def must_wait(self, now_s: float, acknowledged: bool) -> bool:
        """Whether a frame has to wait now; `acknowledged`: whether readers have all that was sent."""
        if acknowledged:
            self._unacknowledged.clear()
        if now_s < self._paid_s:
            self._held_back_by = LIMIT
        elif self._is_late() and now_s < self._sent_s + MAX_WAIT_S:
            self._held_back_by = READERS
        else:
            return False
        return True

    def sent(self, now_s: float, size: int, frames: int) -> None:
        """Take note of a sketch that was sent: its bytes, and the frames that were merged for it."""
        self._paid_s = max(self._paid_s, now_s - BURST_S) + size * self._s_per_byte
        self._unacknowledged.append(size)
        self._sent_s = now_s
        self._recent.append((now_s, size, frames))
        while self._recent[0][0] <= now_s - MEAN_S:
            self._recent.popleft()
        if frames > 1 and self.frames > TOLERATED:
            self.why, self._calm_since_s = self._held_back_by, now_s
            self.step = min(self.step * COARSER, self._coarsest)
        elif now_s >= self._calm_since_s + CALM_S and self.step <= self._finest:
            self.why = ""
        elif now_s >= self._calm_since_s + CALM_S and self.mbit_s * (1 + ROOM) < self.settings[0]:
            self.step, self._calm_since_s = max(self.step * FINER, self._finest), now_s

    def _is_late(self) -> bool:
        return len(self._unacknowledged) == FREE_SKETCHES or sum(self._unacknowledged) > FREE_BYTES

    @property
    def mbit_s(self) -> float:
        """What was sent in the second until the last sketch."""
        return sum(size for _, size, _ in self._recent) * 8e-6 / MEAN_S

    @property
    def frames(self) -> float:
        """The mean of the frames in a sketch, likewise; 1 before the first."""
        return sum(frames for *_, frames in self._recent) / len(self._recent) if self._recent else 1.0
