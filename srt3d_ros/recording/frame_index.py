"""FrameIndex: number the frames of a recording by their stamps."""

from collections import deque
from dataclasses import dataclass

STAMPS_KEPT = 256
RATE_FRAMES = 10        # frames over which the rate is averaged


@dataclass
class RecordedFrame:
    """A frame, numbered in the order in which stamps were first seen; `sketch_ns` is when its sketch arrived."""

    stamp_ns: int
    number: int
    sketch_ns: int | None = None


class FrameIndex:
    """The newest STAMPS_KEPT frames, and the rate of clouds."""

    def __init__(self):
        self._frames: dict[int, RecordedFrame] = {}
        self._seen = 0
        self._clouds: deque[int] = deque(maxlen=RATE_FRAMES)
        self.newest: RecordedFrame | None = None

    def __getitem__(self, stamp_ns: int) -> RecordedFrame:
        """The frame with this stamp, added if new."""
        frame = self._frames.get(stamp_ns)
        if frame is None:
            frame = self._frames[stamp_ns] = RecordedFrame(stamp_ns, self._seen)
            self._seen += 1
            if len(self._frames) > STAMPS_KEPT:
                del self._frames[next(iter(self._frames))]
            if self.newest is None or stamp_ns > self.newest.stamp_ns:
                self.newest = frame
        return frame

    def cloud_came(self, frame: RecordedFrame) -> float | None:
        """Count a frame's cloud; clouds per second by their stamps, None for the first."""
        self._clouds.append(frame.stamp_ns)
        seconds = (self._clouds[-1] - self._clouds[0]) * 1e-9
        return (len(self._clouds) - 1) / seconds if seconds > 0 else None
