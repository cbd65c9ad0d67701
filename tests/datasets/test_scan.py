"""LineScan: pixels of a raster scan from marks, in any cut of the stream."""

import numpy as np
import pytest

from srt3d_ros.datasets.readers.line_scan import FRAME, LINE, STOP, LineScan, Records, chosen_channel, look_at_marks
from srt3d_ros.errors import InvalidInput

# Two frames of two lines of three pixels, four ticks each: (time, mark).
STREAM = [(0, LINE), (1, 0), (5, 0), (11, 0), (12, STOP), (13, 0), (20, LINE), (20, 0), (31, 0), (32, 0), (33, STOP),
          (40, FRAME | LINE), (47, 0), (52, STOP), (60, LINE), (64, 0), (72, STOP), (80, LINE), (81, 0)]
PIXELS = [0, 1, 2, -1, 3, 5, -1, 1, 4, -1]      # of the photons; the last is in a third line of the frame


def pixels(scan: LineScan, stream, cut: int) -> list[int]:
    time, marks = (np.array(column) for column in zip(*stream, strict=True))
    parts = [scan.pixels(time[first:first + cut], marks[first:first + cut].astype(np.uint8))
             for first in range(0, len(time), cut)]
    found = np.concatenate(parts)
    assert (found[marks != 0] == -1).all()
    return found[marks == 0].tolist()


@pytest.mark.parametrize("cut", [1, 2, 5, 100])
def test_photons_are_in_the_pixel_at_their_time(cut):
    assert pixels(LineScan(2, 3, 4), STREAM, cut) == PIXELS
    assert pixels(LineScan(2, 3, 4, skipping=True), STREAM, cut) == [-1] * 7 + PIXELS[7:]   # before the first frame


def test_without_frame_marks_a_frame_has_as_many_lines_as_rows():
    stream = [(time, mark & ~FRAME) for time, mark in STREAM]
    assert pixels(LineScan(2, 3, 4, frames_marked=False), stream, 3) == [*PIXELS[:-1], 0]


def test_odd_rows_may_run_backwards_and_a_table_give_the_columns_of_an_uneven_speed():
    assert pixels(LineScan(2, 3, 4, bidirectional=True), STREAM, 100) == [0, 1, 2, -1, 5, 3, -1, 1, 4, -1]
    table = LineScan(2, 3, 0, column_at=np.array([0] * 5 + [1] * 2 + [2] * 5))
    assert pixels(table, STREAM, 100) == [0, 1, 2, -1, 3, 5, -1, 2, 3, -1]


def records(stream, channel=0) -> list[Records]:
    time, marks = (np.array(column) for column in zip(*stream, strict=True))
    return [Records(time, time * 0, np.where(marks == 0, channel, -1), marks.astype(np.uint8), 1.0)]


def test_marks_tell_lines_lengths_and_frames():
    found = look_at_marks(records(STREAM), rows=2)
    assert (found.lines, found.line_ticks) == (5, 12)
    assert not found.within_frame
    assert look_at_marks(records(STREAM), rows=4).within_frame      # two lines before the first frame are too few


def test_the_channel_with_the_most_photons_is_chosen():
    several = [Records(np.arange(5), np.zeros(5, int), np.array([2, 7, 7, -1, 7]), np.zeros(5, np.uint8), 1.0)]
    assert chosen_channel(several, {})[0] == 7 and chosen_channel(several, {"channel": 2}) == (2, ())
    assert chosen_channel(records(STREAM), {}) == (0, ())
    with pytest.raises(InvalidInput, match="photons is 0"):
        chosen_channel(records([(0, LINE)]), {})
