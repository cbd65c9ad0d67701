"""Read .npz and .npy files: photons (docs/photon-file.md), one frame with its sensor, or what `save` wrote."""

from dataclasses import replace
from pathlib import Path

from srt3d_ros.datasets.named_arrays import KNOWN, WANTED, Content
from srt3d_ros.datasets.options import Options
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, map_npy, read_npz_arrays

MAX_CUBE_BYTES = 2**46


def read(path: Path, options: Options) -> Content:
    """Photons of an .npz file, one by one or as counts, or a saved Sketch or Cloud; other arrays are ignored."""
    arrays, listed = read_npz_arrays(path, (*KNOWN, *options.named))
    return Content(arrays, options, (), listed, WANTED)


def read_npy(path: Path, options: Options) -> Content:
    """Photons of an .npy file of counts, or of words of a SPAD array."""
    most = MAX_ARRAY_BYTES if options.axes is not None else MAX_CUBE_BYTES         # other axes are copied into memory
    arrays = {"counts": map_npy(path, f"{path.name} counts", most)}
    return Content(arrays, replace(options, array=options.array or "counts"), (), "counts", WANTED)
