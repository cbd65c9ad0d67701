"""PicoQuant histograms (.phu), read with ptufile: one curve for each pixel of a row, or of `rows` × `cols`."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor import MAX_BINS
from srt3d_ros.datasets.cubes import cube
from srt3d_ros.datasets.files import naming_file
from srt3d_ros.datasets.ptu import HEADER_BYTES
from srt3d_ros.datasets.stream import Recording
from srt3d_ros.errors import require

EXPECTED = "a PicoQuant .phu file, whole"
MAX_CURVES = 2**16
MAX_CURVE_BINS = 2**20


def read(path: Path, options: dict) -> Recording:
    """The histograms of a .phu file; T ends with the last bin in which a curve has a photon, unless given.

    Raises:
        InvalidInput: naming the file and what of it cannot be used.
        ModuleNotFoundError: ptufile is not installed.
    """
    import ptufile

    with naming_file(path, EXPECTED, "ptufile"):
        with path.open("rb") as file:
            tags = ptufile.PhuFile(io.BytesIO(file.read(HEADER_BYTES))).tags
        offsets, lengths = (np.asarray(tags[f"HistResDscr_{name}"], np.int64)
                            for name in ("DataOffset", "HistogramBins"))
        require(0 < len(offsets) == len(lengths) <= MAX_CURVES, "curves", len(offsets), f"1 to {MAX_CURVES}")
        require(0 < lengths.min() and lengths.max() <= MAX_CURVE_BINS, "bins of a curve", int(lengths.max()),
                f"1 to {MAX_CURVE_BINS}")
        with path.open("rb") as file:
            last = max(_last_bin(file, *curve) for curve in zip(offsets, lengths, strict=True))
        widths = tags.get("HistResDscr_MDescResolution") or [tags.get("MeasDesc_Resolution", 0)]
        widths = np.asarray(widths, np.float64)
    require(widths.min() == widths.max(), f"{path.name} bin widths", f"{widths.min():g} to {widths.max():g} s", "one")
    bins = min(max(last + 1, 2), MAX_BINS if "gate" not in options else MAX_CURVE_BINS)

    def curves(at_once: int) -> Iterator[np.ndarray]:
        with path.open("rb") as file:
            for first in range(0, len(offsets), at_once):
                part = [_curve(file, *one)[:bins] for one in zip(offsets[first:first + at_once], lengths[first:])]
                yield np.stack([np.pad(one, (0, bins - len(one))) for one in part])
    given = {"bin_width_s": float(widths[0])} if widths[0] > 0 else {}
    notes = (f"T taken to be {bins} bins, where the last photon is: the file has no laser period (--num-bins)",) \
        if "num_bins" not in options else ()
    return cube(path, (len(offsets), bins), np.dtype(np.uint32), curves, options, given, notes)


def _curve(file, offset: int, bins: int) -> np.ndarray:
    file.seek(int(offset))
    counts = np.fromfile(file, "<u4", int(bins))
    require(len(counts) == bins, "curve", f"cut off after {len(counts)} bins", f"{bins} bins")
    return counts


def _last_bin(file, offset: int, bins: int) -> int:
    """The last bin of a curve with a photon; 0 if there is none."""
    seen = np.flatnonzero(_curve(file, offset, bins))
    return int(seen[-1]) if len(seen) else 0
