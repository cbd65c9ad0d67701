"""PicoQuant time-tagged photons (.ptu), T3, or T2 with the laser on the sync channel, read with ptufile."""

import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor import MAX_BINS
from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import number, positive_integer
from srt3d_ros.datasets.scan import FRAME, LINE, STOP, LineScan, Records, look_at_marks, recording
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import require

EXPECTED = "a PicoQuant .ptu file, whole"
HEADER_BYTES = 2**24            # what ptufile is given of a file, whose header may claim to be of any length
RECORDS = 2**20                 # decoded at once: 16 MB, and 60 MB while their pixels are looked for
MAX_LINE_TICKS = 2**24          # of a line of uneven speed, for which there is a table
MARKS = {"ImgHdr_LineStart": LINE, "ImgHdr_LineStop": STOP, "ImgHdr_Frame": FRAME}
DEFAULT_BITS = {"ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2}     # of markers, in a file that does not say
PICOHARP_T2 = 0x00010203
PULSES = 2**17                  # that a laser's period is measured on


def read(path: Path, options: dict) -> Recording:
    """The photons of a .ptu file; `options`: rows, cols, channel, num_bins, bin_width_s (T2).

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: ptufile is not installed.
    """
    import ptufile

    with naming_file(path, EXPECTED, "ptufile"), path.open("rb") as file:
        ptu = ptufile.PtuFile(io.BytesIO(file.read(HEADER_BYTES)))
        num_bins, bin_width_s, photons, notes = (_t3 if ptu.is_t3 else _t2)(path, ptu, options)
        records = partial(_marked, ptu, photons)
        new_scan, scan_notes = _scan(ptu, records, options)
        stated, found = int(ptu.tags.get("TTResult_NumberOfRecords", 0)), _whole_records(path, ptu)
        notes += scan_notes + ((f"cut off: {found} of {stated} records are there",) if stated > found else ())
        return recording(path, records, options, new_scan, num_bins, bin_width_s, notes, (EXPECTED, "ptufile"))


def _whole_records(path: Path, ptu) -> int:
    return (path.stat().st_size - ptu.record_offset) // 4


def _records(path: Path, ptu) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Records raw, as ptufile decodes them, their times since the beginning; and the part of the file read."""
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
            carried = time[-1]
            yield raw, decoded[:-1], time[:-1].astype(np.int64), file.tell() / size


def _marked(ptu, photons: Callable[[], Iterator[tuple]]) -> Iterator[Records]:
    """The records of a file from its beginning; `photons` tells their ToA and channels."""
    bits = {tag: int(ptu.tags.get(tag, DEFAULT_BITS.get(tag, 0))) for tag in MARKS}
    for decoded, time, toa, channel, done in photons():
        marks = np.zeros(len(time), np.uint8)
        for tag, mark in MARKS.items():
            if 1 <= bits[tag] <= 8:
                marks[decoded["marker"] & (1 << (bits[tag] - 1)) != 0] |= mark
        yield Records(time, toa, channel, marks, done)


def _t3(path: Path, ptu, options: dict) -> tuple:
    """T, bin width, photons and notes of a T3 file."""
    width_s, period_s = float(ptu.tags["MeasDesc_Resolution"]), float(ptu.tags["MeasDesc_GlobalResolution"])
    require(0 < width_s <= period_s < 1, "MeasDesc_Resolution, MeasDesc_GlobalResolution", f"{width_s:g}, {period_s:g}",
            "seconds of a bin and of a laser period")
    # A period that is no whole number of bins ends within one. Records have no room for more than 2¹⁵ bins.
    bins = min(int(np.ceil(period_s / width_s - 1e-3)), 2**15)
    return bins, width_s, partial(_from_laser, path, ptu), ()


def _from_laser(path: Path, ptu) -> Iterator[tuple]:
    """Records whose ToA are counted from the laser's pulse by the hardware."""
    for _, decoded, time, done in _records(path, ptu):
        yield decoded, time, decoded["dtime"], decoded["channel"], done


def _t2(path: Path, ptu, options: dict) -> tuple:
    """T, bin width, photons and notes of a T2 file: all events have times, those of the laser too."""
    tick_s = float(ptu.tags["MeasDesc_GlobalResolution"])
    require(0 < tick_s < 1, "MeasDesc_GlobalResolution", tick_s, "seconds of a tick")
    period = _laser_period(path, ptu)
    width_s = number("bin_width_s", options.get("bin_width_s", np.ceil(period / MAX_BINS) * tick_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    bins = int(np.ceil(period * tick_s / width_s - 1e-3))
    note = (f"T2: laser period of {period * tick_s * 1e9:.6g} ns measured on the sync channel, "
            f"bins of {width_s * 1e12:g} ps (--bin-width-s)")
    return bins, width_s, partial(_from_sync, path, ptu, period, width_s / tick_s), (note,)


def _laser_period(path: Path, ptu) -> float:
    """Ticks between the pulses of the laser, of which every n-th may have been recorded."""
    pulses = np.zeros(0, np.int64)
    for raw, decoded, time, _ in _records(path, ptu):
        pulses = np.append(pulses, time[_is_sync(ptu, raw, decoded)])
        if len(pulses) > PULSES:
            break
    require(len(pulses) > 1, "sync channel", f"{len(pulses)} events", "the laser's pulses, to count ToA from")
    return max(float(np.median(np.diff(pulses))) / max(int(ptu.tags.get("HWSync_Divider", 1)), 1), 1.0)


def _from_sync(path: Path, ptu, period: float, bin_ticks: float) -> Iterator[tuple]:
    """Records whose ToA count from the newest pulse before each, modulo the period; none before the first pulse."""
    pulse = -1
    for raw, decoded, time, done in _records(path, ptu):
        is_sync = _is_sync(ptu, raw, decoded)
        newest = np.append(pulse, time[is_sync])[np.cumsum(is_sync)]
        pulse = int(newest[-1])
        toa = ((time - newest) % period / bin_ticks).astype(np.int64)
        yield decoded, time, toa, np.where((newest >= 0) & ~is_sync, decoded["channel"], -1), done


def _is_sync(ptu, raw: np.ndarray, decoded: np.ndarray) -> np.ndarray:
    """Which records are of the sync channel: 0 of a PicoHarp 300, of later devices a special record's channel 0."""
    special = True if ptu.record_type == PICOHARP_T2 else raw >> 31 == 1
    return (decoded["channel"] == 0) & special


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
        column_at = sinusoidal_correction(amount, round(ticks * cols), cols)
    if marks.within_frame:
        notes += ("lines before the first frame begins are left out",)
    bidirectional = bool(ptu.tags.get("ImgHdr_BiDirect", False))
    return partial(LineScan, rows, cols, ticks, "ImgHdr_Frame" in ptu.tags, bidirectional, column_at,
                   marks.within_frame), notes
