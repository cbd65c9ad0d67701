"""One module a file format: add its module here and its suffixes to the table.

A module has `read(path, options)`; or, of a file of several frames, `frames(path, options)`. Both give Photons.
"""

from importlib import import_module
from itertools import islice
from pathlib import Path

from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import require

READERS = {".npz": "..photon_file", ".mat": ".mat", ".ptu": ".ptu", ".npy": ".cubes", ".json": ".tmf8829",
           ".gz": ".tmf8829"}


def read(path: Path, frame: int, options: dict) -> Photons:
    """The photons of a file; InvalidInput if it has no such frame.

    Args:
        options: what the file does not say, or says wrongly (options.gathered); and `guess_irf`, whether to take an IRF
            of one bin where none can be estimated, instead of refusing.
    """
    module = import_module(READERS[path.suffix.lower()], __name__)
    if not hasattr(module, "frames"):
        require(frame == 0, "frame", frame, "0: a photon file has one frame")
        return module.read(path, options)
    require(frame >= 0, "frame", frame, "0 or more")
    found = next(islice(module.frames(path, options), frame, None), None)
    require(found is not None, "frame", frame, f"less: {path.name} ends before")
    return found
