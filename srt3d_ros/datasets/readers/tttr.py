"""Read photons of older TCSPC formats with phconvert: Becker & Hickl's FIFO .spc, PicoQuant's .pt3 and .ht3 (T3)."""

import tempfile
from pathlib import Path

import numpy as np

from srt3d_ros.datasets.named_arrays import Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers import hdf5
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_errors

ADC_BINS = 4096             # of the range of a TAC
# Setup of an unknown card, for a file without .set: a header of zeros, and the least that phconvert takes.
NO_SETUP = bytes(64) + b"\n*IDENTIFICATION\nID : none\n*END\n*SETUP\n*END\n"
USUAL_CARD = "SPC-1XX"      # phconvert's name of the records of SPC-130 to 180 and 830
NO_SCAN = "the markers of a scan in the file are not read: save it as .ptu or .sdt"
PICOQUANT = {".pt3": ("load_pt3", 15, 4096), ".ht3": ("load_ht3", 64, 2**15)}     # first special channel, bins
Found = tuple[dict[str, np.ndarray], tuple[str, ...]]       # arrays of Photon-HDF5, and notes


def read(path: Path, options: Options) -> Content:
    """Photons as of Photon-HDF5 with one spot: one pixel. Needs phconvert."""
    suffix = path.suffix.lower()
    expected = f"a complete {suffix} file of a version that phconvert reads; the software that wrote it, or tttrlib, " \
               "converts others"
    with read_errors(path, expected):
        arrays, notes = _spc(path) if suffix == ".spc" else _picoquant(path, *PICOQUANT[suffix])
        require(arrays[hdf5.TOA].size > 0, "photons", problem="The file has no photons.")
    return hdf5.photons(path, Content(arrays, options, notes, "photons", hdf5.WANTED))


def _spc(path: Path) -> Found:
    """The arrays of an .spc file, with the bin width by its .set file if there is one."""
    from phconvert import bhreader

    beside = next((one for one in map(path.with_suffix, (".set", ".SET")) if one.is_file()), None)
    with tempfile.TemporaryDirectory() as folder:
        setup = beside or Path(folder) / "setup.set"
        if beside is None:
            setup.write_bytes(NO_SETUP)
        found = bhreader.load_spc(path, setup, "auto" if beside else USUAL_CARD)
    data, known = found["photon_data"], found["meta"]["setup"]
    photons = ~np.isin(data["detectors"], data["marker_ids"])
    range_s = known.get("SP_TAC_R", 0.0) / known.get("SP_TAC_G", 1)
    notes = [] if beside else [f"no {path.stem}.set beside it, which names the card: taken to be an {USUAL_CARD}"]
    notes += [] if photons.all() else [NO_SCAN]
    return {hdf5.TOA: data["nanotimes"][photons], hdf5.DETECTORS: data["detectors"][photons],
            hdf5.UNIT: np.array(range_s / ADC_BINS), hdf5.NUM_BINS: np.array(ADC_BINS)}, (*notes,)


def _picoquant(path: Path, loader: str, special: int, bins: int) -> Found:
    """The arrays of a .pt3 or .ht3 file, without markers and overflows."""
    from phconvert import pqreader

    _, detectors, nanotimes, meta, _ = getattr(pqreader, loader)(str(path))
    photons = detectors < special
    arrays = {hdf5.TOA: nanotimes[photons], hdf5.DETECTORS: detectors[photons], hdf5.NUM_BINS: np.array(bins),
              hdf5.UNIT: np.array(meta["nanotimes_unit"]), hdf5.LASER: np.array(meta["laser_repetition_rate"])}
    return arrays, (NO_SCAN,) if len(meta["imghdr"]) else ()
