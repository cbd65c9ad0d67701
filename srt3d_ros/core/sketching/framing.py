"""Framing: decides which packets make a frame, which come late, and when a sensor began again.

A frame ends by number, with its last of `packets` messages; or by stamp, with the first packet of a later period of P
nanoseconds, whatever was lost. With both, it ends with whichever comes first.

Packets of the open frame may come in any order, because sketches add. A packet older than the last frame is late. One
that is older by more than a frame shows that the sensor, or a bag, began again.

How long packets may stay away follows from the usual step between their stamps. That is the second largest of the last
2 · packets + 2, so that one pause does not count: a sensor may send the packets of a frame at once and then pause.
"""

from collections import deque
from heapq import nlargest
from math import inf
from typing import NamedTuple

AS_MANY_AS_COME = 1     # packets of a frame that ends by stamp: 1 sets no number
STEPS_KEPT = 1000       # bounds the cost for frames of very many packets
USUAL_STEPS = 10        # longer gaps end a frame, or begin a new recording
LEAP_NS = 10**9         # shorter gaps are no leaps: drivers, networks and busy machines pause for as long
SILENCE_NS = 5 * 10**8  # shorter gaps are no silence, for the same reason; a longer limit delays a driver's last frame


class OpenFrame(NamedTuple):
    """Packets of a frame, and the photons in them."""

    packets: int = 0
    photons: int = 0


class Placed(NamedTuple):
    """What to do about a packet, in this order.

    Args:
        closed: the open frame, if it gets no more packets: it ends, or is dropped if it needs a number of them.
        began_again: the sensor began again: begin a new window with this packet.
        late: drop this packet; else `Framing.add` it.
    """

    closed: OpenFrame | None = None
    began_again: bool = False
    late: bool = False


class Framing:
    """Finds, packet by packet, where frames end, and counts the open frame.

    Args:
        packets: that complete a frame; with a period, 1 sets no number.
        period_ns: P; 0 = frames end by number only.
    """

    open = OpenFrame()

    def __init__(self, packets: int = 1, period_ns: int = 0):
        self.period_ns = period_ns
        self._packets = 0 if period_ns and packets == AS_MANY_AS_COME else packets
        self._steps_ns: deque[int] = deque(maxlen=min(2 * packets + 2, STEPS_KEPT))     # between successive packets
        self._last_ns: int | None = None        # stamp of the last packet, late ones too
        self._frame_ns = period_ns              # from the start of a frame to that of the next, as seen last
        self.clear()

    def clear(self) -> OpenFrame | None:
        """Forget all stamps: the next packet is the first. Returns the open frame, if it has packets."""
        frame, self.open = self.open, OpenFrame()
        self._begin_ns = 0                      # of period 0
        self._only_ns: int | None = None        # the first stamp, until a second one shows how far apart packets are
        self._start_ns = 0                      # earliest stamp of the open frame
        self._newest_ns: int | None = None      # of all packets that were added
        self._ended: float = -inf               # place (`_place`) of the last frame that ended
        return frame if frame.packets else None

    def place(self, stamp_ns: int) -> Placed:
        """What a packet means for the frames; see Placed."""
        began_again = self._begins_again(stamp_ns)
        if self._last_ns is not None:
            self._steps_ns.append(abs(stamp_ns - self._last_ns))
        self._last_ns = stamp_ns
        closed = self.clear() if began_again else None
        self._place_periods(stamp_ns)
        if self._is_late(stamp_ns):
            return Placed(late=True)
        if self.period_ns and self.open.packets and self._place(stamp_ns) > self._place(self._start_ns):
            closed = self._end()
        return Placed(closed, began_again)

    def add(self, stamp_ns: int, photons: int = 0) -> OpenFrame | None:
        """Count a packet in the open frame; returns the frame if that completes it."""
        self._start_ns = min(self._start_ns, stamp_ns) if self.open.packets else stamp_ns
        self.open = OpenFrame(self.open.packets + 1, self.open.photons + photons)
        self._newest_ns = stamp_ns if self._newest_ns is None else max(self._newest_ns, stamp_ns)
        return self._end() if self.open.packets == self._packets else None

    def flush(self) -> OpenFrame | None:
        """End and return the open frame, unless it has no packets or waits for its number of them."""
        return self._end() if self.period_ns and self.open.packets else None

    @property
    def silence_ns(self) -> int:
        """After so long without a packet the open frame is complete."""
        usual_ns = self._usual_step_ns()
        return max(SILENCE_NS, self.period_ns if usual_ns is None else USUAL_STEPS * usual_ns)

    def _begins_again(self, stamp_ns: int) -> bool:
        """Whether stamps leap by more than USUAL_STEPS, periods and LEAP_NS, or fall back behind the last frame."""
        usual_ns = self._usual_step_ns()
        if self._newest_ns is None or usual_ns is None:
            return False
        if abs(stamp_ns - self._newest_ns) > max(LEAP_NS, USUAL_STEPS * max(usual_ns, self.period_ns)):
            return True
        newest = self._place(self._newest_ns) if self.period_ns else self._ended
        return (newest - self._place(stamp_ns)) * (self.period_ns or 1) > max(self._frame_ns, usual_ns)

    def _is_late(self, stamp_ns: int) -> bool:
        """Whether the frame of a packet has ended."""
        place = self._place(stamp_ns)
        if not self.period_ns:
            return place < self._ended
        return place <= self._ended or (self.open.packets > 0 and place < self._place(self._start_ns))

    def _end(self) -> OpenFrame:
        """End and return the open frame."""
        frame, self.open = self.open, OpenFrame()
        before, self._ended = self._ended, self._place(self._start_ns)
        if before > -inf:
            self._frame_ns = (self._ended - before) * (self.period_ns or 1)
        return frame

    def _place_periods(self, stamp_ns: int) -> None:
        """Begin period 0 before the first stamp by half the time to the second, at most half a period.

        Stamps that jitter then stay in their period.
        """
        if self._newest_ns is None:
            self._begin_ns = self._only_ns = stamp_ns
        elif self._only_ns not in (None, stamp_ns):
            self._begin_ns -= min(abs(stamp_ns - self._begin_ns), self.period_ns) // 2
            self._only_ns = None

    def _place(self, stamp_ns: int) -> int:
        """Where a stamp lies in the order of frames: its period, or the stamp itself if frames have no period."""
        return (stamp_ns - self._begin_ns) // self.period_ns if self.period_ns else stamp_ns

    def _usual_step_ns(self) -> int | None:
        """The second longest of the newest steps; None while there are not two."""
        longest = nlargest(2, self._steps_ns)
        return longest[1] if len(longest) == 2 else None
