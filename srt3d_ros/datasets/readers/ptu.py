"""PicoQuant time-tagged photons (.ptu, T3), read with ptufile."""

import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import positive_integer
from srt3d_ros.datasets.readers.line_scan import FRAME, LINE, STOP, LineScan, Records, look_at_marks, recording
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import require

EXPECTED = "a PicoQuant .ptu file, whole"
HEADER_BYTES = 2**24            # what ptufile is given of a file, whose header may claim to be of any length
RECORDS = 2**20                 # decoded at once: 16 MB, and 60 MB while their pixels are looked for
MAX_LINE_TICKS = 2**24          # of a line of uneven speed, for which there is a table
MARKS = {"ImgHdr_LineStart": LINE, "ImgHdr_LineStop": STOP, "ImgHdr_Frame": FRAME}
DEFAULT_BITS = {"ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2}     # of markers, in a file that does not say


def read(path: Path, options: dict) -> Recording:
    """The photons of a .ptu file; `options`: rows, cols, channel, num_bins.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: ptufile is not installed.
    """
    import ptufile

    with naming_file(path, EXPECTED, "ptufile"), path.open("rb") as file:
        ptu = ptufile.PtuFile(io.BytesIO(file.read(HEADER_BYTES)))
        require(ptu.is_t3, "measurement mode", "T2", "T3: record with the laser's pulses on the sync input, in T3 mode")
        num_bins, bin_width_s = _bins(ptu)
        records = partial(_records, path, ptu)
        new_scan, notes = _scan(ptu, records, options)
        stated, found = int(ptu.tags.get("TTResult_NumberOfRecords", 0)), _whole_records(path, ptu)
        notes += ((f"cut off: {found} of {stated} records are there",) if stated > found else ())
        return recording(path, records, options, new_scan, num_bins, bin_width_s, notes, (EXPECTED, "ptufile"))


def _whole_records(path: Path, ptu) -> int:
    return (path.stat().st_size - ptu.record_offset) // 4


def _records(path: Path, ptu) -> Iterator[Records]:
    """The records of a file from its beginning."""
    bits = {tag: int(ptu.tags.get(tag, DEFAULT_BITS.get(tag, 0))) for tag in MARKS}
    size, stated = path.stat().st_size, int(ptu.tags.get("TTResult_NumberOfRecords", 0))
    left = stated if stated > 0 else _whole_records(path, ptu)
    carried = np.uint64(0)
    with path.open("rb") as file:
        file.seek(ptu.record_offset)
        while left > 0 and len(raw := np.fromfile(file, np.uint32, min(RECORDS, left))):
            left -= len(raw)
            # ptufile counts the clock's overflows within what it is given: a record at tick 0 has them all.
            decoded = ptu.decode_records(np.append(raw, np.uint32(0)))
            time = decoded["time"] + carried
            carried, decoded = time[-1], decoded[:-1]
            marks = np.zeros(len(raw), np.uint8)
            for tag, mark in MARKS.items():
                if 1 <= bits[tag] <= 8:
                    marks[decoded["marker"] & (1 << (bits[tag] - 1)) != 0] |= mark
            yield Records(time[:-1].astype(np.int64), decoded["dtime"], decoded["channel"], marks, file.tell() / size)


def _bins(ptu) -> tuple[int, float]:
    """T and the bin width."""
    width_s, period_s = float(ptu.tags["MeasDesc_Resolution"]), float(ptu.tags["MeasDesc_GlobalResolution"])
    require(0 < width_s <= period_s < 1, "MeasDesc_Resolution, MeasDesc_GlobalResolution", f"{width_s:g}, {period_s:g}",
            "seconds of a bin and of a laser period")
    # A period that is no whole number of bins ends within one. Records have no room for more than 2¹⁵ bins.
    return min(int(np.ceil(period_s / width_s - 1e-3)), 2**15), width_s


def _scan(ptu, records: Callable[[], Iterator[Records]], options: dict) -> tuple[Callable[[], LineScan], tuple]:
    """What makes a LineScan, of one pixel if there is no scan; and notes."""
    rows, cols = (positive_integer(name, options.get(name, ptu.tags.get(tag, 1)))
                  for name, tag in (("rows", "ImgHdr_PixY"), ("cols", "ImgHdr_PixX")))
    if rows * cols == 1:
        return partial(LineScan, 1, 1, 0), ("all photons are in one pixel: the file has no scan (--rows, --cols)",)
    marks = look_at_marks(records(), rows)
    require(marks.lines > 0, "marks of lines", 0, "some, as the scanner sends: its pixels cannot be told otherwise")
    pixel_s, notes = float(ptu.tags.get("ImgHdr_TimePerPixel", 0)) * 1e-3, ()
    if pixel_s > 0:
        ticks = max(round(pixel_s / float(ptu.tags["MeasDesc_GlobalResolution"])), 1)
    else:
        require(marks.line_ticks > 0, "marks of lines", marks.lines, "several, where ImgHdr_TimePerPixel is missing")
        ticks, notes = marks.line_ticks / cols, ("pixels' time taken from the length of lines: the file has none",)
    column_at = None
    if (amount := float(ptu.tags.get("ImgHdr_SinCorrection", 0))) > 0:
        from ptufile.ptufile import sinusoidal_correction

        require(ticks * cols <= MAX_LINE_TICKS, "line", ticks * cols, f"at most {MAX_LINE_TICKS} ticks")
        column_at = sinusoidal_correction(amount, round(ticks * cols), cols).astype(np.int64)
    if marks.within_frame:
        notes += ("lines before the first frame begins are left out",)
    bidirectional = bool(ptu.tags.get("ImgHdr_BiDirect", False))
    return partial(LineScan, rows, cols, ticks, "ImgHdr_Frame" in ptu.tags, bidirectional, column_at,
                   marks.within_frame), notes
