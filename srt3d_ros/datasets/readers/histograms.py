"""Read histograms of TCSPC electronics: Becker & Hickl's .sdt and PicoQuant's .phu."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers.cubes import cube
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.values import Note
from srt3d_ros.errors import finite, require
from srt3d_ros.files import tcspc_files
from srt3d_ros.files.array_files import read_errors


def read(path: Path, options: Options) -> Reading:
    """Photons of the data set `channel`, from 0, or the one with the most; or of all, if they are rows × cols pixels.

    T is the laser's period if nearly all of it was recorded, else what was recorded: of .sdt the range of the TAC, of
    .phu the bins up to the last photon. Needs sdtfile or ptufile.
    """
    sets = tcspc_files.READERS[path.suffix.lower()](path)
    with read_errors(path):
        chosen, notes = tcspc_files.brightest(sets), ()
        listed = ", ".join(map(str, range(len(sets))))
        shape = tuple(int(finite(name, options.known.get(name, 1))) for name in ("rows", "cols"))
        if options.channel is not None:
            chosen = int(finite("channel", options.channel, "a data set's number"))
            require(chosen in range(len(sets)), "channel", chosen, f"a data set of the file: {listed}")
        elif 1 < len(sets) == shape[0] * shape[1]:
            return _of_curves(path, sets, shape, options)
        elif len(sets) > 1:
            notes = (f"photons of data set {chosen}, which has the most, of {listed} (--channel)",)
    return _cube(path, sets[chosen], options, notes)


def _of_curves(path: Path, sets: list[tcspc_files.Histograms], shape: tuple[int, int], options: Options) -> Reading:
    """Photons of data sets of one pixel each, row by row."""
    bins = max(one.counts.shape[-1] for one in sets)
    for one in sets:
        require(one.counts.size == one.counts.shape[-1], "data set", one.counts.shape, f"one pixel, for {shape}")
        require(one[1:] == sets[0][1:], "bins of data sets", one[1:], f"{sets[0][1:]}, as of the first")
    counts = np.stack([np.pad(one.counts.reshape(-1), (0, bins - one.counts.size)) for one in sets])
    return _cube(path, sets[0]._replace(counts=counts.reshape(*shape, bins)), options, ())


def _cube(path: Path, histograms: tcspc_files.Histograms, options: Options, notes: tuple[str, ...]) -> Reading:
    counts, width_s, period = histograms
    counts = counts.reshape(*(1, 1, *counts.shape)[-3:])
    bins = counts.shape[2]
    stated = {"bin_width_s": width_s} if width_s else {}
    if bins <= period <= MAX_BINS:
        stated["num_bins"] = period
    elif period:
        notes += Note(f"T taken to be the {bins} bins that have photons: the laser's rate in the file means {period} "
                      "(--num-bins)", "num_bins"),
    elif path.suffix.lower() == ".phu":
        notes += Note(f"T taken to be {bins} bins, up to the last photon: the file has no laser period (--num-bins)",
                      "num_bins"),
    return cube(path, counts, options.without("channel"), stated, notes)
