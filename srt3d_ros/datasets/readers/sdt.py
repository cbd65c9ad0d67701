"""Becker & Hickl histograms (.sdt), read with sdtfile."""

from pathlib import Path

import numpy as np

from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.readers.cubes import cube, parts_of
from srt3d_ros.datasets.recording import Recording
from srt3d_ros.datasets.values import number
from srt3d_ros.errors import require

EXPECTED = "a Becker & Hickl .sdt file of histograms, whole"


def read(path: Path, options: dict) -> Recording:
    """The histograms of an .sdt file; `channel`: which data set (or routing channel), counted from 0.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: sdtfile is not installed.
    """
    with naming_file(path, EXPECTED):
        sets = _histograms(path)
    channel, notes = options.get("channel"), ()
    if channel is not None:
        channel = number("channel", channel, "the number of a data set, from 0")
        require(channel in range(len(sets)), "channel", f"{channel:g}", f"0 to {len(sets) - 1}")
    elif len(sets) > 1:
        channel = np.argmax([counts.sum(dtype=np.float64) for counts, _ in sets])
        notes = f"data set {channel}, which has the most photons, of {len(sets)} (--channel)",
    counts, width_s = sets[int(channel or 0)]
    given = {"bin_width_s": width_s} if width_s > 0 else {}
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes)


def _histograms(path: Path) -> list[tuple[np.ndarray, float]]:
    """Of each data set the counts [rows, cols, bins] or [curves, bins], and the seconds of a bin, 0 if not known."""
    from sdtfile import SdtFile

    sets = []
    with SdtFile(path) as file:
        for counts, times in zip(file.data, file.times, strict=True):
            counts = np.atleast_2d(counts)
            width_s = float(times[1] - times[0]) if len(times) > 1 else 0.0
            sets += [(np.ascontiguousarray(one), width_s)
                     for one in (counts.reshape(-1, *counts.shape[-3:]) if counts.ndim > 3 else counts[None])]
    require(len(sets) > 0, "data", "none", EXPECTED)
    return sets
