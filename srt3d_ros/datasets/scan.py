"""LineScan: which pixel of a raster scan each photon of a time-tagged stream falls into, by the marks of the scanner."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from srt3d_ros.datasets.photons import number
from srt3d_ros.errors import require

LINE, STOP, FRAME = 1, 2, 4         # bits of a mark: a line begins, a line ends, a new frame begins with the next line


@dataclass
class LineScan:
    """Follows a stream from chunk to chunk; times and marks in the order of their recording.

    Args:
        rows, cols: pixels of a frame. All frames add up.
        pixel_ticks: time of a pixel, in ticks of the stream's clock.
        frames_marked: FRAME marks say where row 0 is; without, a frame has `rows` lines.
        bidirectional: odd rows are scanned from right to left.
        column_at: column for each tick of a line, where the speed is not even; replaces `pixel_ticks`.
        skipping: leave out what comes before the first FRAME mark.
    """

    rows: int
    cols: int
    pixel_ticks: float
    frames_marked: bool = True
    bidirectional: bool = False
    column_at: np.ndarray | None = None
    skipping: bool = False
    _row: int = field(default=-1, init=False)           # of the newest line
    _begun: int = field(default=-1, init=False)         # when that line began; -1: no line is open

    def pixels(self, time: np.ndarray, marks: np.ndarray) -> np.ndarray:
        """The pixel of each event, int64 [N]; -1 for marks and for photons outside the lines.

        Args:
            time: int64 [N], ticks.
            marks: uint8 [N], 0 for a photon, else bits LINE, STOP, FRAME.
        """
        is_mark = marks & (LINE | STOP | FRAME) != 0
        at = np.flatnonzero(is_mark)
        mark = marks[at]
        begins, new_frame = mark & LINE != 0, mark & FRAME != 0
        lines = np.cumsum(begins)
        # Lines before the newest frame; one that begins with the frame's own mark is its first.
        before = np.maximum.accumulate(np.where(new_frame, lines - begins, -(self._row + 1)))
        begun = np.where(begins, time[at], -1)
        if self.skipping:
            first = int(np.argmax(new_frame)) if new_frame.any() else len(at)
            begun[:first], self.skipping = -1, not new_frame.any()
        rows = np.append(self._row, lines - before - 1)
        begun = np.append(self._begun, begun)
        self._row, self._begun = int(rows[-1]), int(begun[-1])
        newest = np.cumsum(is_mark)
        return np.where(is_mark | (marks != 0), -1, self._pixels_at(rows[newest], begun[newest], time))

    def _pixels_at(self, row: np.ndarray, begun: np.ndarray, time: np.ndarray) -> np.ndarray:
        """The pixel at each time, of a line of this row that began then; -1 outside."""
        ticks = time - begun
        if self.rows * self.cols == 1:
            return np.zeros(len(time), np.int64)
        line_ticks = self.cols * self.pixel_ticks if self.column_at is None else len(self.column_at)
        inside = (begun >= 0) & (ticks >= 0) & (ticks < line_ticks)
        if not self.frames_marked:
            row = row % self.rows
        if self.bidirectional:
            ticks = np.where(row % 2 == 1, int(line_ticks) - 1 - ticks, ticks)
        ticks = np.where(inside, ticks, 0)
        col = (ticks / self.pixel_ticks).astype(np.int64) if self.column_at is None else self.column_at[ticks]
        return np.where(inside & (row >= 0) & (row < self.rows) & (col < self.cols), row * self.cols + col, -1)


class Marks(NamedTuple):
    """What the first marks of a recording say.

    Args:
        lines: how many lines were seen, up to the first FRAME mark or the length of a frame.
        line_ticks: median length of a line, up to the next mark.
        within_frame: the recording begins within a frame, whose rows cannot be told.
    """

    lines: int
    line_ticks: float
    within_frame: bool


def look_at_marks(events: Iterable[tuple[np.ndarray, np.ndarray]], rows: int) -> Marks:
    """Look at the first marks of a recording, given as (time, marks) of its chunks."""
    times, kinds = [], []
    lines, framed = 0, False
    for time, marks in events:
        at = np.flatnonzero(marks)
        times.append(time[at])
        kinds.append(marks[at])
        framed = framed or bool((kinds[-1] & FRAME).any())
        lines += int(np.count_nonzero(kinds[-1] & LINE))
        if framed or lines >= rows:
            break
    time, kind = np.concatenate(times or [np.zeros(0)]), np.concatenate(kinds or [np.zeros(0, np.uint8)])
    lengths = np.diff(time)[kind[:-1] & LINE != 0]
    first = int(np.argmax(kind & FRAME != 0)) if framed else 0
    before = int(np.count_nonzero(kind[:first] & LINE))
    # One line may be missing: scanners' first and last marks get lost.
    return Marks(lines, float(np.median(lengths)) if len(lengths) else 0.0, 0 < before < rows - 1)


def chosen_channel(channels: Iterable[np.ndarray], options: dict) -> tuple[int, tuple[str, ...]]:
    """The channel whose photons are taken, and a note if there are others.

    Args:
        channels: of each event of the recording's chunks, -1 for what is no photon.
        options: `channel`; else the one with the most photons in the first chunk that has any.
    """
    seen, photons = np.zeros(0, np.int64), None
    for channel in channels:
        seen, photons = np.unique(channel[channel >= 0], return_counts=True)
        if len(seen):
            break
    require(len(seen) > 0, "photons", 0, "some")
    if "channel" in options:
        return int(number("channel", options["channel"], "a channel's number")), ()
    chosen = int(seen[np.argmax(photons)])
    others = ", ".join(str(one) for one in seen)
    return chosen, () if len(seen) == 1 else (f"photons of channel {chosen}, which has the most, of channels {others} "
                                              "(--channel)",)
