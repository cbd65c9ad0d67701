"""Becker & Hickl histograms (.sdt), read with sdtfile in a child process: it trusts the file's sizes."""

from pathlib import Path

import numpy as np

from srt3d_ros.datasets.cubes import cube, parts_of
from srt3d_ros.datasets.files import in_child
from srt3d_ros.datasets.photons import number
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import require

EXPECTED = "a Becker & Hickl .sdt file of histograms, whole"
MAX_MEMORY_BYTES = 3 * 2**30        # sdtfile reads all blocks of a file, and unpacks them
MAX_SECONDS = 300.0


def read(path: Path, options: dict) -> Recording:
    """The histograms of an .sdt file; `channel`: which data set (or routing channel), counted from 0.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: sdtfile is not installed.
    """
    channel = options.get("channel")
    wanted = -1 if channel is None else int(number("channel", channel, "the number of a data set, from 0"))
    found = in_child(histograms, path, wanted, expected=EXPECTED, memory_bytes=MAX_MEMORY_BYTES, timeout_s=MAX_SECONDS)
    counts, sets = found["counts"], int(found["sets"])
    notes = (f"data set {int(found['chosen'])}, which has the most photons, of {sets} (--channel)",) \
        if channel is None and sets > 1 else ()
    given = {"bin_width_s": float(found["bin_width_s"])} if found["bin_width_s"] > 0 else {}
    return cube(path, counts.shape, counts.dtype, parts_of(counts), options, given, notes)


def histograms(path: str, channel: int) -> dict[str, np.ndarray]:
    """The counts [rows, cols, bins] or [curves, bins] of a data set, of -1 the one with the most; seconds of a bin."""
    from sdtfile import SdtFile

    with SdtFile(path) as file:
        sets, widths = [], []
        for counts, times in zip(file.data, file.times, strict=True):
            counts = np.atleast_2d(counts)
            each = counts.reshape(-1, *counts.shape[-3:]) if counts.ndim > 3 else counts[None]
            sets += list(each)
            widths += [float(times[1] - times[0]) if len(times) > 1 else 0.0] * len(each)
    require(len(sets) > 0, Path(path).name, "without data", EXPECTED)
    require(-1 <= channel < len(sets), "channel", channel, f"0 to {len(sets) - 1}")
    chosen = channel if channel >= 0 else int(np.argmax([one.sum(dtype=np.float64) for one in sets]))
    return {"counts": np.ascontiguousarray(sets[chosen]), "bin_width_s": np.float64(widths[chosen]),
            "sets": np.int64(len(sets)), "chosen": np.int64(chosen)}
