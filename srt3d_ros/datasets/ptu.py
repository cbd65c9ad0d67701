"""PicoQuant time-tagged photons (.ptu), T3, or T2 with the laser on the sync channel, read with ptufile."""

import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor import MAX_BINS
from srt3d_ros.datasets.files import one_error
from srt3d_ros.datasets.photons import number, positive_integer
from srt3d_ros.datasets.scan import FRAME, LINE, STOP, LineScan, chosen_channel, look_at_marks
from srt3d_ros.datasets.stream import Events, Recording
from srt3d_ros.errors import require

EXPECTED = "a PicoQuant .ptu file, whole"
HEADER_BYTES = 2**24            # what ptufile is given of a file, whose header may claim to be of any length
RECORDS = 2**20                 # decoded at once: 16 MB, and 60 MB while their pixels are looked for
MAX_LINE_TICKS = 2**24          # of a line of uneven speed, for which there is a table
MARKS = {"ImgHdr_LineStart": LINE, "ImgHdr_LineStop": STOP, "ImgHdr_Frame": FRAME}
DEFAULT_BITS = {"ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2}     # of markers, in a file that does not say
PICOHARP_T2 = 0x00010203


class Records(NamedTuple):
    """Some records: time in ticks of the clock; ToA in bins and channel of photons (else -1); marks of the scanner."""

    time: np.ndarray
    toa: np.ndarray
    channel: np.ndarray
    marks: np.ndarray
    done: float


def read(path: Path, options: dict) -> Recording:
    """The photons of a .ptu file; `options`: rows, cols, channel, num_bins, bin_width_s (T2).

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: ptufile is not installed.
    """
    import ptufile

    with one_error(path, EXPECTED, "ptufile"), path.open("rb") as file:
        ptu = ptufile.PtuFile(io.BytesIO(file.read(HEADER_BYTES)))
        num_bins, bin_width_s, convert, timing_notes = (_t3 if ptu.is_t3 else _t2)(path, ptu, options)
        events = partial(_events, path, ptu, convert)
        channel, channel_notes = chosen_channel((part.channel for part in events()), options)
        new_scan, scan_notes = _scan(ptu, events, options)

    def chunks() -> Iterator[Events]:
        with one_error(path, EXPECTED, "ptufile"):
            scan = new_scan()
            for part in events():
                pixel = scan.pixels(part.time, part.marks)
                photon = np.flatnonzero(part.channel == channel)
                yield Events(pixel[photon], part.toa[photon], part.done)

    scan = new_scan()
    return Recording(scan.rows, scan.cols, num_bins, bin_width_s, chunks, path.stem,
                     timing_notes + channel_notes + scan_notes)


def _records(path: Path, ptu) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Records as they are and as ptufile decodes them, with times since the beginning; part of the file read."""
    size = path.stat().st_size
    stated = int(ptu.tags.get("TTResult_NumberOfRecords", 0))
    left = stated if stated > 0 else size
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


def _events(path: Path, ptu, convert: Callable) -> Iterator[Records]:
    """The records of a file from its beginning; `convert()` gives what makes ToA and channel of them."""
    bits = {tag: int(ptu.tags.get(tag, DEFAULT_BITS.get(tag, 0))) for tag in MARKS}
    timing = convert()
    for raw, decoded, time, done in _records(path, ptu):
        marks = np.zeros(len(time), np.uint8)
        for tag, mark in MARKS.items():
            if 1 <= bits[tag] <= 8:
                marks[decoded["marker"] & (1 << (bits[tag] - 1)) != 0] |= mark
        yield Records(time, *timing(raw, decoded, time), marks, done)


def _t3(path: Path, ptu, options: dict) -> tuple:
    """T, bin width, conversion and notes of a T3 file: ToA are counted from the laser's pulse by the hardware."""
    width_s, period_s = float(ptu.tags["MeasDesc_Resolution"]), float(ptu.tags["MeasDesc_GlobalResolution"])
    require(0 < width_s <= period_s < 1, "MeasDesc_Resolution, MeasDesc_GlobalResolution", f"{width_s:g}, {period_s:g}",
            "seconds of a bin and of a laser period")
    # A period that is no whole number of bins ends within one. Records have no room for more than 2¹⁵ bins.
    bins = min(int(np.ceil(period_s / width_s - 1e-3)), 2**15)
    return bins, width_s, lambda: lambda raw, decoded, time: (decoded["dtime"], decoded["channel"]), ()


def _t2(path: Path, ptu, options: dict) -> tuple:
    """T, bin width, conversion and notes of a T2 file: all events have times, those of the laser too."""
    tick_s = float(ptu.tags["MeasDesc_GlobalResolution"])
    require(0 < tick_s < 1, "MeasDesc_GlobalResolution", tick_s, "seconds of a tick")
    syncs = np.zeros(0, np.int64)
    for raw, decoded, time, _ in _records(path, ptu):
        syncs = np.append(syncs, time[_is_sync(ptu, raw, decoded)])
        if len(syncs) > RECORDS // 8:
            break
    require(len(syncs) > 1, "sync channel", f"{len(syncs)} events", "the laser's pulses, to count ToA from")
    divider = max(int(ptu.tags.get("HWSync_Divider", 1)), 1)
    period = max(float(np.median(np.diff(syncs))) / divider, 1.0)
    coarser = max(int(np.ceil(period / MAX_BINS)), 1)
    width_s = number("bin_width_s", options.get("bin_width_s", coarser * tick_s), "seconds, above 0")
    require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
    bins = int(np.ceil(period * tick_s / width_s - 1e-3))
    note = f"T2: laser period of {period * tick_s * 1e9:.6g} ns measured on the sync channel, bins of " \
        f"{width_s * 1e12:g} ps (--bin-width-s)"
    return bins, width_s, lambda: _FromSync(ptu, period, width_s / tick_s), (note,)


class _FromSync:
    """ToA of a T2 file's photons, from the newest sync event before each."""

    def __init__(self, ptu, period: float, bin_ticks: float):
        self._ptu, self._period, self._bin_ticks, self._sync = ptu, period, bin_ticks, -1

    def __call__(self, raw: np.ndarray, decoded: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        is_sync = _is_sync(self._ptu, raw, decoded)
        newest = np.append(self._sync, time[is_sync])[np.cumsum(is_sync)]
        self._sync = int(newest[-1])
        toa = ((time - newest) % self._period / self._bin_ticks).astype(np.int64)
        return toa, np.where(is_sync | (newest < 0), -1, decoded["channel"])


def _is_sync(ptu, raw: np.ndarray, decoded: np.ndarray) -> np.ndarray:
    """Which records are of the sync channel: 0 of a PicoHarp 300, of later devices a special record's channel 0."""
    special = True if ptu.record_type == PICOHARP_T2 else raw >> 31 == 1
    return (decoded["channel"] == 0) & special


def _scan(ptu, events: Callable[[], Iterator[Records]], options: dict) -> tuple[Callable[[], LineScan], tuple[str, ...]]:
    """What makes a LineScan, of one pixel if there is no scan; and notes."""
    rows, cols = (positive_integer(name, options.get(name, ptu.tags.get(tag, 1)))
                  for name, tag in (("rows", "ImgHdr_PixY"), ("cols", "ImgHdr_PixX")))
    if rows * cols == 1:
        return partial(LineScan, 1, 1, 0), ("all photons are in one pixel: the file has no scan (--rows, --cols)",)
    marks = look_at_marks(((part.time, part.marks) for part in events()), rows)
    require(marks.lines > 0, "marks of lines", 0, "some, as the scanner sends: its pixels cannot be told otherwise")
    pixel_s, notes = float(ptu.tags.get("ImgHdr_TimePerPixel", 0)) * 1e-3, ()
    if pixel_s > 0:
        ticks = max(round(pixel_s / float(ptu.tags["MeasDesc_GlobalResolution"])), 1)
    else:
        ticks, notes = marks.line_ticks / cols, ("pixels' time taken from the length of lines: the file has none",)
    column_at = None
    if (amount := float(ptu.tags.get("ImgHdr_SinCorrection", 0))) > 0:
        require(ticks * cols <= MAX_LINE_TICKS, "line", ticks * cols, f"at most {MAX_LINE_TICKS} ticks, with ImgHdr_SinCorrection")
        from ptufile.ptufile import sinusoidal_correction
        column_at = sinusoidal_correction(amount, round(ticks * cols), cols)
    if marks.within_frame:
        notes += (f"{marks.lines} lines before the first frame begins are left out",)
    return partial(LineScan, rows, cols, ticks, "ImgHdr_Frame" in ptu.tags, bool(ptu.tags.get("ImgHdr_BiDirect", False)),
                   column_at, marks.within_frame), notes
