"""LineScan: which pixel of a raster scan each photon of a time-tagged stream is in, by the marks of the scanner."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import number
from srt3d_ros.datasets.stream import Events, Recording
from srt3d_ros.errors import require

# Bits of a mark: a line begins, a line ends, a new frame begins with the next line.
LINE, STOP, FRAME = 1, 2, 4


class Records(NamedTuple):
    """Photons and marks of a recording in the order of their times.

    Attributes:
        time: int64 [N], ticks since the beginning.
        toa: int64 [N], bins, of photons.
        channel: int64 [N], of photons; -1 else.
        marks: uint8 [N], bits LINE, STOP, FRAME; 0 of photons.
        done: the part of the file that has been read, 0 … 1.
    """

    time: np.ndarray
    toa: np.ndarray
    channel: np.ndarray
    marks: np.ndarray
    done: float


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
        if self.rows * self.cols == 1:
            return np.where(marks == 0, 0, -1)
        at = np.flatnonzero(marks)
        mark = marks[at]
        begins, new_frame = mark & LINE != 0, mark & FRAME != 0
        lines = np.cumsum(begins)
        # Lines before the newest frame; one that begins with the frame's own mark is its first.
        before = np.maximum.accumulate(np.where(new_frame, lines - begins, -(self._row + 1)))
        begun = np.where(begins, time[at], -1)
        if self.skipping:
            first = int(np.argmax(new_frame)) if new_frame.any() else len(at)
            begun[:first], self.skipping = -1, not new_frame.any()
        rows, begun = np.append(self._row, lines - before - 1), np.append(self._begun, begun)
        self._row, self._begun = int(rows[-1]), int(begun[-1])
        events = np.diff(at, prepend=0, append=len(marks))      # up to the first mark, and from each to the next
        row, begun = np.repeat(rows, events), np.repeat(begun, events)
        col = self._cols(row, time - begun)
        row = row if self.frames_marked else row % self.rows
        inside = (marks == 0) & (begun >= 0) & (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)
        return np.where(inside, row * self.cols + col, -1)

    def _cols(self, row: np.ndarray, ticks: np.ndarray) -> np.ndarray:
        """The column at so many ticks since a line of this row began; -1 outside."""
        line_ticks = self.cols * self.pixel_ticks if self.column_at is None else len(self.column_at)
        inside = (ticks >= 0) & (ticks < line_ticks)
        if self.bidirectional:
            ticks = np.where(row % 2 == 1, int(line_ticks) - 1 - ticks, ticks)
        ticks = np.where(inside, ticks, 0)
        col = (ticks / self.pixel_ticks).astype(np.int64) if self.column_at is None else self.column_at[ticks]
        return np.where(inside, col, -1)


class Marks(NamedTuple):
    """What the first marks of a recording say.

    Args:
        lines: how many lines were seen.
        line_ticks: median length of a line, up to the next mark.
        within_frame: the recording begins within a frame, whose rows cannot be told.
    """

    lines: int
    line_ticks: float
    within_frame: bool


def look_at_marks(records: Iterable[Records], rows: int) -> Marks:
    """Look at the first marks of a recording: of a frame and the beginning of the next."""
    time, kind = np.zeros(0, np.int64), np.zeros(0, np.uint8)
    for part in records:
        at = np.flatnonzero(part.marks)
        time, kind = np.append(time, part.time[at]), np.append(kind, part.marks[at])
        if np.count_nonzero(kind & LINE) > rows:
            break
    begins, frames = kind & LINE != 0, kind & FRAME != 0
    lengths = np.diff(time)[begins[:-1]]
    before = int(np.count_nonzero(begins[:np.argmax(frames)])) if frames.any() else 0
    # One line may be missing: scanners' first and last marks get lost.
    return Marks(int(np.count_nonzero(begins)), float(np.median(lengths)) if len(lengths) else 0.0,
                 0 < before < rows - 1)


def chosen_channel(records: Iterable[Records], options: dict) -> tuple[int, tuple[str, ...]]:
    """The channel whose photons are taken, and a note if there are others.

    Args:
        options: `channel`; else the one with the most photons in the first chunk that has any.
    """
    channels = (part.channel[part.channel >= 0] for part in records)
    seen, photons = np.unique(next(filter(len, channels), ()), return_counts=True)
    require(len(seen) > 0, "photons", 0, "some")
    if "channel" in options:
        return int(number("channel", options["channel"], "a channel's number")), ()
    chosen, others = int(seen[np.argmax(photons)]), ", ".join(map(str, seen))
    note = f"photons of channel {chosen}, which has the most, of channels {others} (--channel)"
    return chosen, (note,) if len(seen) > 1 else ()


def recording(path: Path, records: Callable[[], Iterator[Records]], options: dict, new_scan: Callable[[], LineScan],
              num_bins: int, bin_width_s: float, notes: tuple[str, ...], errors: tuple[str, ...]) -> Recording:
    """The photons of a channel in the pixels of a scan.

    Args:
        records: begins to read the file anew.
        options: `channel`; else the one with the most photons in the first chunk that has any, and a note.
        new_scan: begins a scan.
        num_bins, bin_width_s, notes: of the recording.
        errors: of `naming_file`, for what goes wrong as the file is read.
    """
    channel, others = chosen_channel(records(), options)

    def chunks() -> Iterator[Events]:
        scan = new_scan()
        with naming_file(path, *errors):
            for part in records():
                pixel, photon = scan.pixels(part.time, part.marks), np.flatnonzero(part.channel == channel)
                yield Events(pixel[photon], part.toa[photon], part.done)
    scan = new_scan()
    return Recording(scan.rows, scan.cols, num_bins, bin_width_s, chunks, path.stem, others + notes)
