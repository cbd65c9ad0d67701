"""Read PicoQuant's photons (.ptu, T3) with ptufile."""

from pathlib import Path

import numpy as np

from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers import ptu_t2
from srt3d_ros.datasets.values import channel_of
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES
from srt3d_ros.files.tcspc_files import open_ptu, ptu_bins

COUNT_DTYPE = np.dtype(np.uint32)
SUMMED = slice(None, None, -1)          # ptufile adds up the photons along an axis with this index


def read(path: Path, options: Options) -> Content:
    """Photons of a .ptu file, all frames added up, of `channel` or the channel with the most. Needs ptufile."""
    with open_ptu(path) as ptu:
        if not ptu.is_t3:
            return ptu_t2.read(ptu, options)
        for mark in ptu_t2.MARKS & {*ptu.tags}:
            require(1 <= ptu.tags[mark] <= 8, mark, ptu.tags[mark], "a marker from 1 to 8")
        num_bins, bin_width_s = ptu_bins(ptu)
        channels = dict.fromkeys(ptu.active_channels, 0)
        if len(channels) > 1 and options.channel is None:
            photons = ptu.decode_image((*[SUMMED] * (len(ptu.shape) - 2), None, SUMMED), dtype=COUNT_DTYPE).reshape(-1)
            channels = {number: photons[number - min(channels)] for number in channels}
        channel, notes = channel_of(channels, options.channel)
        scanned = ptu.shape[1:-2]       # (rows, cols) of an image, (cols,) of a line, () of a point
        rows = scanned[-2] if len(scanned) > 1 else 1
        cols = scanned[-1] if scanned else 1
        if rows * cols == 1:
            notes += ("all photons are in one pixel: the file has no scan",)
        records = (path.stat().st_size - ptu.record_offset) // 4
        if records < ptu.number_records:
            notes += (f"cut off: {records} of {ptu.number_records} records are there",)
        size = rows * cols * num_bins * COUNT_DTYPE.itemsize
        require(size <= MAX_ARRAY_BYTES, "size", f"{size} bytes of counts", f"at most {MAX_ARRAY_BYTES}")
        counts = ptu.decode_image(frame=-1, channel=channel - ptu.active_channels[0], dtime=num_bins, dtype=COUNT_DTYPE,
                                  keepdims=False)
        counts = counts.reshape(rows, cols, num_bins).view(np.int32)       # int32 is sketched without a copy
        return Content({"counts": counts, "bin_width_s": bin_width_s}, options.without("channel"), notes)
