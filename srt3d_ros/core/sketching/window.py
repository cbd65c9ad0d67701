"""Sketches of a sliding window: the newest W frames as one sketch, at the cost of one frame, whatever W."""

from collections import deque

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.core.sketching.sketcher import Sketcher
from srt3d_ros.errors import require

MAX_WINDOW_BYTES = 2**31
Sums = tuple[np.ndarray, np.ndarray]


class WindowSketcher(Sketcher):
    """Photons add up without end; a window is what has been added since its first frame began.

    Its stamp is that of its newest frame: with it, tf is right for the newest photons.

    The sums are integers that wrap around, so the difference is exact: bit for bit the sketch of the window's photons,
    however they were cut into frames and however long this runs. Memory: one set of sums a frame of the window.

    Args:
        sensor, frequencies, gate: as for a Sketcher.
        window_frames: W, 1 or more.

    Raises:
        InvalidInput: also if the window would take more than MAX_WINDOW_BYTES.
    """

    def __init__(self, sensor: SensorModel, frequencies, window_frames: int = 1, gate: Gate | None = None):
        super().__init__(sensor, frequencies, gate=gate)
        # Of the window's frames, the open one last: what had been added before each (None: nothing), its first stamp.
        self._before: deque[Sums | None] = deque([None])
        self._stamps_ns: deque[int] = deque()
        self._difference: Sums | None = None
        self.resize(window_frames)

    def resize(self, window_frames: int) -> None:
        """Change W; a longer window grows frame by frame. Raises InvalidInput as above."""
        bytes_each = self._sums.nbytes + self._photons.nbytes
        most = max(MAX_WINDOW_BYTES // bytes_each, 1)
        require(1 <= window_frames <= most, "window_frames", window_frames, f"1 to {most} for {self.sensor.rows} × "
                f"{self.sensor.cols} pixels, which take {bytes_each / 1e6:.3g} MB a frame")
        self.window_frames = window_frames
        self._trim()

    def reset(self) -> None:
        """Forget all photons, of the open frame and of all before."""
        super().reset()
        self._before = deque([None])
        self._stamps_ns.clear()

    @property
    def kept(self) -> int:
        """Photons of the open frame that are inside the gate, which there has to be: more than all of them if there are
        negative counts outside."""
        column = slice(2 * len(self.frequencies), 2 * len(self.frequencies) + 1)
        here, before = self._sums[:, column], self._before[-1]
        if before is not None:
            here = here - before[0][:, column]
        return int(self._kernels.counted(here, 0).sum())

    def end_frame(self) -> Sketch:
        """End the open frame; the sketch of the window of which it is the last."""
        self._stamps_ns.append(self._stamp_ns or 0)
        self._stamp_ns = max(self._stamps_ns)
        sketch = self._sketch_since(self._before[0])
        if self.window_frames == 1:             # cheaper than keeping what was added before
            self.reset()
        else:
            self._stamp_ns = None
            self._before.append(self._copy(self._before.popleft() if len(self._before) == self.window_frames else None))
            self._trim()
        return sketch

    def _trim(self) -> None:
        """Forget the frames that the next window will not cover."""
        while len(self._before) > self.window_frames:
            self._before.popleft()
        while len(self._stamps_ns) >= len(self._before):
            self._stamps_ns.popleft()

    def _sketch_since(self, before: Sums | None) -> Sketch:
        if before is None:
            return self.sketch()
        if self._difference is None:
            self._difference = self._copy(None)
        for whole, part, out in zip((self._sums, self._photons), before, self._difference, strict=True):
            np.subtract(whole, part, out=out)
        return self._sketch_of(*self._difference)

    def _copy(self, into: Sums | None) -> Sums:
        """A copy of the sums up to now, in `into` if there is one."""
        if into is None:
            return self._sums.copy(), self._photons.copy()
        for out, values in zip(into, (self._sums, self._photons), strict=True):
            out[:] = values
        return into
