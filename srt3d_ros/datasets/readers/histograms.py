"""Read histograms of TCSPC electronics: Becker & Hickl's .sdt and PicoQuant's .phu."""

from pathlib import Path

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.values import Note, channel_of
from srt3d_ros.files import tcspc_files
from srt3d_ros.files.array_files import read_errors


def read(path: Path, options: Options) -> Content:
    """Photons of the data set `channel`, from 0, or the one with the most.

    T is the laser's period if nearly all of it was recorded, else what was recorded: of .sdt the range of the TAC, of
    .phu the bins up to the last photon. Needs sdtfile or ptufile.
    """
    sets = tcspc_files.READERS[path.suffix.lower()](path)
    with read_errors(path):
        chosen, notes = channel_of(tcspc_files.photons(sets), options.channel, "data set")
        counts, width_s, period = sets[chosen]
        arrays, bins = {"counts": counts.reshape(*(1, 1, *counts.shape)[-3:])}, counts.shape[-1]
        arrays |= {"bin_width_s": width_s} if width_s else {}
        if bins <= period <= MAX_BINS:
            arrays["num_bins"] = period
        elif period or path.suffix.lower() == ".phu":
            said = f"the laser's rate in the file means {period}" if period else "the file has no laser period"
            notes += Note(f"T taken to be the {bins} bins that have photons: {said} (--num-bins)", "num_bins"),
        return Content(arrays, options.without("channel"), notes)
