"""Becker & Hickl photons (.spc with its .set), read with phconvert, piece by piece."""

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.photons import number, positive_integer
from srt3d_ros.datasets.scan import FRAME, LINE, PIXEL, LineScan, Records, look_at_marks, recording
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import require

EXPECTED = "a Becker & Hickl .spc file beside its .set file, of a card that phconvert knows"
PIECE = 2**20                   # records that phconvert is given at once: 100 MB while it works
MAX_SETTINGS_BYTES = 2**24
MARKS = {1: PIXEL, 2: LINE, 4: FRAME}       # bits of a marker's number: pixel, line and frame clock
OLD_CARDS = (0x21, 0x22)        # SPC-600 and 630: 48 bits a record if the third word of the header is 0
QC_CARDS = (0x8B, 0x8C, 0x8D, 0x8E)
MARKER, INVALID = np.uint32(0x90000000), np.uint32(1 << 31)     # bits of a record, of cards that are neither


def read(path: Path, options: dict) -> Recording:
    """The photons of an .spc file; `rows`, `cols`: of its scan; `channel`; `bin_width_s`.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: phconvert is not installed.
    """
    from phconvert import bhreader

    settings = next((one for one in map(path.with_suffix, (".set", ".SET")) if one.is_file()), None)
    require(settings is not None, path.name, "without its .set file", f"{path.stem}.set beside it: it names the card")
    size = settings.stat().st_size
    require(size <= MAX_SETTINGS_BYTES, f"{settings.name} size", size, f"at most {MAX_SETTINGS_BYTES} bytes")
    with naming_file(path, EXPECTED):
        setup = bhreader.load_set(settings)["setup"]
        records = partial(_records, path, settings)
        width_s = number("bin_width_s", options.get("bin_width_s", setup.get("SP_TAC_TC", 0)), "seconds, above 0")
        require(width_s > 0, "bin_width_s", width_s, "seconds, above 0")
        rows, cols = (positive_integer(name, options.get(name, 1)) for name in ("rows", "cols"))
        new_scan = partial(LineScan, 1, 1, 0)
        note = "all photons are in one pixel: give the rows and cols of a scan (--rows, --cols)"
        if rows * cols > 1:
            marks = look_at_marks(records(), rows)
            seen = marks.lines > 0 and (marks.pixels or marks.line_ticks > 0)
            require(seen, "marks of lines", marks.lines, "several (marker 1), as the scanner sends")
            new_scan = partial(LineScan, rows, cols, marks.line_ticks / cols, marks.frames, skipping=marks.within_frame,
                               pixels_marked=marks.pixels)
            note = (f"columns by {'the pixel clock' if marks.pixels else 'the time since the line began'}, rows by "
                    f"marker 1, frames by {'marker 2' if marks.frames else 'the number of lines'}")
        return recording(path, records, options, new_scan, 4096, width_s, (note,), (EXPECTED,))


def _records(path: Path, settings: Path) -> Iterator[Records]:
    """The records of a file from its beginning, with times since then."""
    size, carried = path.stat().st_size, np.uint64(0)
    with path.open("rb") as file:
        head = file.read(6)
        card = int.from_bytes(settings.read_bytes()[:2], "little") >> 4 & 0xFF
        bytes_each = 6 if card in OLD_CARDS and head[4:] == b"\0\0" else 4
        file.seek(bytes_each)
        while piece := file.read(PIECE * bytes_each):
            piece = piece[:len(piece) // bytes_each * bytes_each]
            if card not in (*OLD_CARDS, *QC_CARDS):     # their markers count as invalid, and phconvert leaves those out
                words = np.frombuffer(piece, "<u4")
                piece = np.where(words & MARKER == MARKER, words & ~INVALID, words).astype("<u4").tobytes()
            # phconvert counts the clock's overflows within what it is given: a record at tick 0 has them all.
            found = _decoded(head[:bytes_each] + piece + bytes(bytes_each), settings)
            time = found["timestamps"].astype(np.uint64) + carried
            carried = time[-1]
            number_of = found["detectors"].astype(np.int64)
            marks, is_mark = np.zeros(len(time), np.uint8), np.isin(number_of, found["marker_ids"])
            # It numbers markers behind the detectors, from a power of two.
            offset = 1 << (int(found["marker_ids"].min()).bit_length() - 1) if is_mark.any() else 0
            for bit, mark in MARKS.items():
                marks[is_mark & (number_of - offset & bit != 0)] |= mark
            yield Records(time[:-1].astype(np.int64), found["nanotimes"][:-1].astype(np.int64),
                          np.where(is_mark, -1, number_of)[:-1], marks[:-1], file.tell() / size)


def _decoded(piece: bytes, settings: Path) -> dict[str, np.ndarray]:
    """What phconvert, which reads whole files, makes of a piece of one."""
    from phconvert import bhreader

    with open(os.memfd_create("piece"), "w+b") as file:
        file.write(piece)
        file.flush()
        return bhreader.load_spc(f"/proc/self/fd/{file.fileno()}", settings)["photon_data"]
