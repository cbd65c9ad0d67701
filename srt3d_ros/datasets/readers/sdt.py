"""Read Becker & Hickl histograms (.sdt) with sdtfile."""

from pathlib import Path

import numpy as np

from srt3d_ros.datasets.readers import isolated
from srt3d_ros.datasets.readers.cubes import cube
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.errors import finite, require
from srt3d_ros.files.array_files import read_errors


def read(path: Path, options: dict) -> Reading:
    """Photons of an .sdt file, of the data set `channel`, from 0, or the one with the most. Needs sdtfile."""
    arrays, _ = isolated.arrays_of(path, "sdtfile", (), "a complete Becker & Hickl .sdt file of histograms")
    with read_errors(path):
        sets = [name for name in arrays if name.isdecimal()]
        require(len(sets) > 0, "data sets", problem="The file has no histograms.")
        chosen, notes = max(sets, key=lambda name: arrays[name].sum(dtype=np.float64)), ()
        if "channel" in options:
            chosen = str(int(finite("channel", options["channel"], "a data set's number")))
            require(chosen in sets, "channel", chosen, f"a data set of the file: {', '.join(sets)}")
        elif len(sets) > 1:
            notes = (f"photons of data set {chosen}, which has the most, of {', '.join(sets)} (--channel)",)
    width_s = float(arrays[f"{chosen}.width"])
    others = {name: value for name, value in options.items() if name != "channel"}
    return cube(path, arrays[chosen], others, {"bin_width_s": width_s} if width_s else {}, notes)
