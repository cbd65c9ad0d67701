"""Histograms of TCSPC files as plain arrays: Becker & Hickl's .sdt, PicoQuant's .phu and .ptu (T3)."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_errors

LONGEST_PERIOD = 1.25       # of what is recorded: of a longer one the bins without records would count as empty


class Histograms(NamedTuple):
    """A data set of a file."""

    counts: np.ndarray          # whole numbers [..., bins]
    bin_width_s: float          # 0 if the file has none
    period_bins: int = 0        # of the laser, if it is stated and nearly all of it was recorded, else 0


def sdt_sets(path: Path) -> list[Histograms]:
    """The data sets of an .sdt file, [rows, cols, bins] each; curves [curves, bins] are a row. Needs sdtfile.

    A block of several detectors has as many data sets.
    """
    import sdtfile

    with read_errors(path, "a complete Becker & Hickl .sdt file of histograms"), sdtfile.SdtFile(path) as file:
        names = file.measure_info[0].dtype.names
        laser_hz = float(file.measure_info[0]["StopInfo"]["max_sync_rate"].item()) if "StopInfo" in names else 0.0
        sets = [_histograms(part, float(times[1] - times[0]) if len(times) > 1 else 0.0, laser_hz, part.shape[-1])
                for counts, times in zip(file.data, file.times, strict=True)
                if counts.size and counts.dtype.kind in "iu"
                for part in counts.reshape(-1, *(1, 1, *counts.shape)[-3:])]
    require(len(sets) > 0, f"{path.name} data sets", problem=f"{path.name}: The file has no histograms.")
    return sets


def phu_curves(path: Path) -> list[Histograms]:
    """The curves of a .phu file, [bins] each, without the empty bins behind a curve's last photon. Needs ptufile."""
    import ptufile

    with read_errors(path, "a complete PicoQuant .phu file"), ptufile.PhuFile(path) as file:
        tags, curves = file.tags, file.number_histograms
        lengths = [int(bins) for bins in tags["HistResDscr_HistogramBins"]]
        stored = 0 < len(lengths) and 0 < min(lengths) and 4 * sum(lengths) <= path.stat().st_size
        require(stored, "bins of curves", lengths, "1 or more, as many as the file holds")
        widths = tags.get("HistResDscr_MDescResolution") or [file.tcspc_resolution] * curves
        rates = tags.get("HistResDscr_SyncRate") or [tags.get("HistResult_SyncRate", 0)] * curves
        found = file.histograms()
        require([len(one) for one in found] == lengths, "", problem="The file is cut off.")
        return [_histograms(np.trim_zeros(counts, "b"), float(width_s), rate, bins)
                for counts, width_s, rate, bins in zip(found, widths, rates, lengths, strict=True)]


@contextmanager
def open_ptu(path: Path) -> Iterator[Any]:
    """An open .ptu file of ptufile; all errors are InvalidInput."""
    import ptufile

    logging.getLogger("ptufile").disabled = True        # what it logs of a damaged file is in the error
    with read_errors(path, "a complete PicoQuant .ptu file"), ptufile.PtuFile(path) as file:
        yield file


def ptu_channels(path: Path) -> list[Histograms]:
    """A curve [bins] of all photons for each channel of a T3 .ptu file. Needs ptufile."""
    with open_ptu(path) as file:
        require(file.is_t3, "measurement mode", "T2", "T3, whose photons have times since the laser's pulse")
        bins, width_s = ptu_bins(file)
        return [Histograms(counts, width_s, bins) for counts in file.decode_histogram(dtime=bins, dtype=np.uint32)]


def ptu_bins(file: Any) -> tuple[int, float]:
    """T and the bin width in seconds of an open T3 .ptu file."""
    width_s, period_s = file.tcspc_resolution, file.global_resolution
    require(0 < width_s <= period_s < 1, "MeasDesc_Resolution, MeasDesc_GlobalResolution", f"{width_s:g}, {period_s:g}",
            "the bin and the laser period, in seconds")
    # Round up: a period that is not a whole number of bins ends inside the last one.
    return min(int(np.ceil(period_s / width_s - 1e-3)), file.number_bins_max), width_s


READERS = {".sdt": sdt_sets, ".phu": phu_curves, ".ptu": ptu_channels}


def photons(sets: list[Histograms]) -> dict[int, float]:
    """The number of photons of each data set, by its index."""
    return {index: float(one.counts.sum(dtype=np.float64)) for index, one in enumerate(sets)}


def _histograms(counts: np.ndarray, width_s: float, laser_hz: float, recorded: int) -> Histograms:
    """A data set of so many recorded bins, whose last ones may be left out of the counts."""
    period = round(1 / (laser_hz * width_s)) if laser_hz * width_s > 1e-9 else 0
    return Histograms(counts, width_s, period if period <= LONGEST_PERIOD * recorded else 0)
