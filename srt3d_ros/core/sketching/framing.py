"""Framing: which packets make which frame, and which come late, or from a sensor that began again.

A frame ends when it is complete, by number (`packets` messages), or by stamp: frame k holds the stamps of
[k·P, (k+1)·P), and ends with the first packet of a later period, whatever was lost on the way. With both, a frame ends
with its last packet if all come, and with the next frame's first if not.

Within the open frame packets may come in any order: sketches add. What is older than the last frame is late, unless it
is older by more than a frame: then the sensor, or a bag, began again.

How long packets may stay away follows from the usual step between their stamps: the second longest of the newest, of
about two frames. A sensor may send the packets of a frame at once and then pause, and one leap alone is not usual.
"""

from collections import deque
from dataclasses import dataclass
from heapq import nlargest
from typing import NamedTuple

AS_MANY_AS_COME = 1     # with a period, a number of packets that says nothing
STEPS_KEPT = 1000       # bounds the cost where frames have very many packets
USUAL_STEPS = 10        # that may be missing at a stretch, before more is taken for an end or a new beginning
LEAP_NS = 10**9         # less is no leap: drivers, networks and busy machines pause for so long, and go on
SILENCE_NS = 5 * 10**8  # less is no silence, for the same reason; longer, the last frame of a driver would be late


class OpenFrame(NamedTuple):
    """Packets of a frame, and the photons in them."""

    packets: int = 0
    photons: int = 0


@dataclass(frozen=True, slots=True)
class Placed:
    """What to do about a packet, in this order.

    Args:
        ended: the frame that ends without this packet, or None.
        forgotten: the frame that is given up, or None.
        began_again: no frame before this packet belongs together with it.
        late: this packet must not be used; else `Framing.add` it.
    """

    ended: OpenFrame | None = None
    forgotten: OpenFrame | None = None
    began_again: bool = False
    late: bool = False


class Framing:
    """Finds, packet by packet, where frames end, and counts the open frame.

    The grid of periods begins before the first packet by half the time to the second, but at most by half a period,
    so that stamps which jitter stay in their period.

    Args:
        packets: that complete a frame; with a period 1 stands for as many as come.
        period_ns: P; 0 = frames end by number only.
    """

    def __init__(self, packets: int = 1, period_ns: int = 0):
        self._period_ns = period_ns
        self._steps_ns: deque[int] = deque(maxlen=min(2 * packets + 2, STEPS_KEPT))     # between successive packets
        self._last_ns: int | None = None
        self._frame_ns = period_ns              # from the start of a frame to that of the next, as seen last
        self._packets = 0 if period_ns and packets == AS_MANY_AS_COME else packets
        self.open = OpenFrame()
        self.clear()

    def clear(self) -> OpenFrame | None:
        """Forget all stamps: the next packet is the first. The open frame, if it has packets."""
        frame, self.open = self.open, OpenFrame()
        self._start_ns: int | None = None       # of the open frame: its earliest stamp
        self._newest_ns: int | None = None
        self._over: int | None = None           # the last frame: by number its start, by stamp its period
        self._grid_ns: int | None = None        # where period 0 begins
        self._first_ns: int | None = None       # until the second stamp shows how far apart packets are
        return frame if frame.packets else None

    def place(self, stamp_ns: int) -> Placed:
        """What a packet means for the frames; see Placed.

        Stamps that fall back by more than a frame behind the last one, or leap ahead by more than USUAL_STEPS, or
        periods, and LEAP_NS, say that the driver, the bag or the clock began again: the open frame ends if it has a
        period, and is given up if it needs a number.
        """
        ended = forgotten = None
        began_again = self._newest_ns is not None and (self._is_leap(abs(stamp_ns - self._newest_ns))
                                                       or self._falls_back(stamp_ns))
        if self._last_ns is not None:
            self._steps_ns.append(abs(stamp_ns - self._last_ns))
        self._last_ns = stamp_ns
        if began_again:
            frame = self.clear()
            ended, forgotten = (frame, None) if self._period_ns else (None, frame)
        if self._period_ns:
            self._lay_grid(stamp_ns)
        if self._is_late(stamp_ns):
            return Placed(late=True)
        if self._period_ns and self.open.packets and self._period_of(stamp_ns) > self._period_of(self._start_ns):
            ended = self._end()
        return Placed(ended, forgotten, began_again)

    def add(self, stamp_ns: int, photons: int = 0) -> OpenFrame | None:
        """Count a packet that was placed in the open frame; the frame if it is complete now."""
        self.open = OpenFrame(self.open.packets + 1, self.open.photons + photons)
        self._start_ns = stamp_ns if self._start_ns is None else min(self._start_ns, stamp_ns)
        self._newest_ns = stamp_ns if self._newest_ns is None else max(self._newest_ns, stamp_ns)
        return self._end() if self.open.packets == self._packets else None

    @property
    def silence_ns(self) -> int:
        """Without a packet for so long, the open frame has got all that it gets; may be called from any thread."""
        usual_ns = self._usual_step_ns()
        return max(SILENCE_NS, self._period_ns if usual_ns is None else USUAL_STEPS * usual_ns)

    def _is_leap(self, step_ns: int) -> bool:
        if step_ns <= LEAP_NS:
            return False
        usual_ns = self._usual_step_ns()
        return usual_ns is not None and step_ns > USUAL_STEPS * max(usual_ns, self._period_ns)

    def _falls_back(self, stamp_ns: int) -> bool:
        """Whether a stamp is more than a frame older than the last frame; if less, its packet is only late."""
        usual_ns, last_ns = self._usual_step_ns(), self._over
        if self._period_ns:
            last_ns, stamp_ns = (self._period_ns * self._period_of(ns) for ns in (self._newest_ns, stamp_ns))
        return None not in (usual_ns, last_ns) and last_ns - stamp_ns > max(self._frame_ns, usual_ns)

    def _usual_step_ns(self) -> int | None:
        """The second longest of the newest steps; None while there are not two."""
        longest = nlargest(2, tuple(self._steps_ns))
        return longest[1] if len(longest) == 2 else None

    def flush(self) -> OpenFrame | None:
        """The open frame, which ends unless it waits for its number of packets; else None."""
        return self._end() if self._period_ns and self.open.packets else None

    def _end(self) -> OpenFrame:
        frame, self.open = self.open, OpenFrame()
        before, self._over = self._over, self._period_of(self._start_ns) if self._period_ns else self._start_ns
        if before is not None:
            self._frame_ns = (self._over - before) * (self._period_ns or 1)
        self._start_ns = None
        return frame

    def _is_late(self, stamp_ns: int) -> bool:
        if not self._period_ns:
            return self._over is not None and stamp_ns < self._over
        period = self._period_of(stamp_ns)
        return (self._over is not None and period <= self._over
                or self._start_ns is not None and period < self._period_of(self._start_ns))

    def _period_of(self, stamp_ns: int) -> int:
        return (stamp_ns - self._grid_ns) // self._period_ns

    def _lay_grid(self, stamp_ns: int) -> None:
        if self._grid_ns is None:
            self._grid_ns = self._first_ns = stamp_ns
        elif self._first_ns is not None and stamp_ns != self._first_ns:
            self._grid_ns -= min(abs(stamp_ns - self._first_ns), self._period_ns) // 2
            self._first_ns = None
