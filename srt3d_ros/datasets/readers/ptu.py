"""PicoQuant time-tagged photons (.ptu, T3), read with ptufile."""

import shutil
import tempfile
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers.cubes import cube
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import read_errors

EXPECTED = "a PicoQuant .ptu file, whole"
COUNT = np.dtype(np.uint32)
IN_MEMORY_BYTES, MAX_BYTES = 2**28, 2**34       # of counts; those between lie in a temporary file
MARKS = ("ImgHdr_LineStart", "ImgHdr_LineStop", "ImgHdr_Frame")
ALL = slice(None, None, -1)         # ptufile adds up what is along this axis


def read(path: Path, options: dict) -> Photons:
    """The photons of a .ptu file, its frames added up; `channel`: whose, else that with the most.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: ptufile is not installed.
    """
    import ptufile

    with read_errors(path, EXPECTED, "ptufile"), ptufile.PtuFile(path) as ptu:
        require(ptu.is_t3, "measurement mode", "T2", "T3: record with the laser's pulses on the sync input, in T3 mode")
        for mark in filter(ptu.tags.__contains__, MARKS):
            require(1 <= ptu.tags[mark] <= 8, mark, ptu.tags[mark], "a bit of markers, 1 to 8")
        stated, found = ptu.number_records, (path.stat().st_size - ptu.record_offset) // 4
        num_bins, bin_width_s = _bins(ptu)
        channel, others = _channel(ptu, options)
        rows, cols = (1, 1, *ptu.shape[1:-2])[-2:]          # of an image, a line or a point
        notes = others + ("all photons are in one pixel: the file has no scan",) * (rows * cols == 1)
        notes += (f"cut off: {found} of {stated} records are there",) * (stated > found)
        size = rows * cols * num_bins * COUNT.itemsize
        free = shutil.disk_usage(tempfile.gettempdir()).free
        require(size <= max(IN_MEMORY_BYTES, min(free, MAX_BYTES)), "size", f"{size} bytes of counts",
                f"at most {MAX_BYTES}, and as much room in {tempfile.gettempdir()}")
        counts = ptu.decode_image(frame=-1, channel=channel - ptu.active_channels[0], dtime=num_bins, dtype=COUNT,
                                  keepdims=False, out=None if size <= IN_MEMORY_BYTES else "memmap")
        counts = counts.reshape(rows, cols, num_bins).view(np.int32)       # which is not copied to be sketched
    options = {name: value for name, value in options.items() if name != "channel"}
    return cube(path, counts, options, {"bin_width_s": bin_width_s}, notes)


def _bins(ptu) -> tuple[int, float]:
    """T and the bin width."""
    width_s, period_s = ptu.tcspc_resolution, ptu.global_resolution
    require(0 < width_s <= period_s < 1, "MeasDesc_Resolution, MeasDesc_GlobalResolution", f"{width_s:g}, {period_s:g}",
            "seconds of a bin and of a laser period")
    # A period that is no whole number of bins ends within one.
    return min(int(np.ceil(period_s / width_s - 1e-3)), ptu.number_bins_max), width_s


def _channel(ptu, options: dict) -> tuple[int, tuple[str, ...]]:
    """The channel whose photons are taken, and a note if there are others."""
    channels = ptu.active_channels
    require(len(channels) > 0, "photons", 0, "some")
    if "channel" in options:
        chosen = int(finite("channel", options["channel"], "a channel's number"))
        require(chosen in channels, "channel", chosen, f"one with photons: {', '.join(map(str, channels))}")
        return chosen, ()
    photons = ptu.decode_image((*[ALL] * (len(ptu.shape) - 2), None, ALL), dtype=COUNT).reshape(-1)
    chosen = channels[0] + int(np.argmax(photons))
    note = f"photons of channel {chosen}, which has the most, of channels {', '.join(map(str, channels))} (--channel)"
    return chosen, (note,) if len(channels) > 1 else ()
