"""LinoSPAD2's raw times (.dat, firmware 2212): 256 pixels in a row, times counted within cycles of acquisition.

A file is a sequence of cycles; a cycle 65 TDCs of the same number of words; a word 28 bits of time, two bits for one of
a TDC's four pixels, and a highest bit that says whether it is valid. The 65th TDC has no pixels. The form was read from
the authors' own reader (github.com/sevaedmi/LinoSPAD2).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.photons import number
from srt3d_ros.datasets.stream import Events, Recording
from srt3d_ros.errors import require

TDCS, PIXELS_OF_TDC = 65, 4
BIN_S = 2.5e-9 / 140            # a TDC divides its clock's 2.5 ns by 140, not quite evenly
VALID, TIME = np.uint32(2**31), np.uint32(2**28 - 1)
MOST_WORDS = 4096               # of a TDC in a cycle
LOOKED_AT = 2**21               # words, to find out how many a TDC has


def read(path: Path, options: dict) -> Recording:
    """The photons of a raw file; `num_bins`: the laser's period, modulo which times become ToA. Must be given.

    Raises:
        InvalidInput: naming the file or option that cannot be used.
    """
    require("num_bins" in options, "num_bins", "missing", f"the laser's period in bins of {BIN_S * 1e12:.4g} ps: "
            "LinoSPAD2's files have times only")
    period = int(number("num_bins", options["num_bins"], "a number of bins"))
    require(period > 1, "num_bins", period, "2 or more")
    size = path.stat().st_size // 4
    words = _words_of_a_tdc(path, size)
    cycle = TDCS * words

    def chunks() -> Iterator[Events]:
        cycles = max(2**20 // cycle, 1)
        tdc = np.repeat(np.arange(TDCS), words)
        with path.open("rb") as file:
            for done in range(0, size // cycle, cycles):
                raw = np.fromfile(file, "<u4", cycle * min(cycles, size // cycle - done)).reshape(-1, cycle)
                valid = (raw >= VALID) & (tdc < TDCS - 1)
                pixel = tdc * PIXELS_OF_TDC + (raw >> np.uint32(28) & np.uint32(3))
                yield Events(pixel[valid], (raw[valid] & TIME) % period, (done + len(raw)) * cycle / size)
    notes = (f"ToA are times modulo {period} bins of {BIN_S * 1e12:.4g} ps; the TDCs' unevenness is not corrected",
             f"{words} words for a TDC in a cycle, by the form of the file")
    width_s = number("bin_width_s", options.get("bin_width_s", BIN_S), "seconds")
    return Recording(1, (TDCS - 1) * PIXELS_OF_TDC, period, width_s, chunks, path.stem, notes)


def _words_of_a_tdc(path: Path, size: int) -> int:
    """So many that the 65th TDC of a cycle never has a valid word, and valid words come before others."""
    head = np.fromfile(path, "<u4", min(LOOKED_AT, size)) >= VALID
    fitting = []
    for words in range(1, min(MOST_WORDS, size // TDCS) + 1):
        if size % (TDCS * words) == 0 and len(head) >= TDCS * words:
            cycles = head[:len(head) // (TDCS * words) * TDCS * words].reshape(-1, TDCS, words)
            if not cycles[:, -1].any() and bool((cycles[:, :, :-1] >= cycles[:, :, 1:]).all()):
                fitting.append(words)
    require(len(fitting) > 0, f"{path.name}", f"{size} words", "LinoSPAD2's raw file, firmware 2212: cycles of 65 TDCs")
    return fitting[-1]
