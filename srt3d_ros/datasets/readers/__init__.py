"""One module a file format: add its module here and its suffixes to the table.

A module has `read(path, options)`, which gives a `Recording`, or `Photons` if the file describes its sensor; or, of a
file of several frames, `frames(path, options)`.
"""

from importlib import import_module
from itertools import islice
from pathlib import Path
from types import ModuleType

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.options import ASSUMED_FOV, check_same, described, outside_note, replaced_note, says_geometry
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.recording import Recording, StoredPhotons
from srt3d_ros.datasets.values import number
from srt3d_ros.errors import require

READERS = {".npz": "npz", ".mat": "mat", ".ptu": "ptu", ".h5": "hdf5", ".hdf5": "hdf5", ".npy": "cubes",
           ".json": "tmf8829", ".gz": "tmf8829"}


def module_of(path: Path) -> ModuleType | None:
    """The module that reads a file, by its suffix; None if there is none."""
    name = READERS.get(path.suffix.lower())
    return None if name is None else import_module(f"{__name__}.{name}")


def read(path: Path, frame: int, options: dict, guess_irf: bool = False) -> Photons:
    """The photons of a file; InvalidInput if it has no such frame.

    Args:
        options: what the file does not say, or says wrongly (options.gathered).
        guess_irf: take an IRF of one bin where none can be estimated, instead of refusing.
    """
    module = module_of(path)
    if not hasattr(module, "frames"):
        require(frame == 0, "frame", frame, "0: a photon file has one frame")
        found = module.read(path, options)
        return completed(found, options, guess_irf) if isinstance(found, Recording) else found
    require(frame >= 0, "frame", frame, "0 or more")
    found = next(islice(module.frames(path, options), frame, None), None)
    require(found is not None, "frame", frame, f"less: {path.name} ends before")
    return found


def completed(recording: Recording, options: dict, guess_irf: bool) -> Photons:
    """The photons of a recording, in memory if they are few enough, and their sensor."""
    notes = recording.notes + replaced_note(recording.given, options)
    options = recording.given | options
    check_same({"rows": recording.rows, "cols": recording.cols}, options)
    bins = int(number("num_bins", options.get("num_bins", recording.num_bins), "a number of bins"))
    first, last = options.get("gate", (0, bins - 1))
    require(1 <= last - first < MAX_BINS, "num_bins", last - first + 1,
            f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
    # Checked before anything is read.
    plain = SensorModel(recording.rows, recording.cols, last - first + 1, recording.bin_width_s, np.ones(1))
    stored = StoredPhotons(recording, first, plain.num_bins)
    if "irf" not in options:
        options["irf"], note = irfs.estimated(stored.sample, plain.num_bins, guess_irf)
        notes += (note,)
    notes += () if says_geometry(options) else (ASSUMED_FOV,)
    sensor = described(plain, {name: value for name, value in options.items() if name != "num_bins"})
    sensor = sensor.replace(toa_offset_bins=sensor.toa_offset_bins + first)
    notes += outside_note(stored.outside, round(stored.photons) + stored.outside, first, last)
    reference = recording.reference
    if reference is not None:
        depth = reference - np.float32(first)
        depth = np.where((depth >= 0) & (depth < plain.num_bins), depth, np.float32(np.nan))
        reference = depth[None] + np.float32(sensor.first_bin_center)
    is_whole = stored.countable and stored.sample.photons == stored.photons
    return Photons(sensor, stored.sample if is_whole else stored, reference, recording.name, notes)
