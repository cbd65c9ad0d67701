"""Photon files (npz, published .mat) and the simulator: all give a SensorModel and the photons of frames."""

from dataclasses import replace
from pathlib import Path

from srt3d_ros.datasets import mat, npz, options
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput

__all__ = ["Photons", "open_photons"]


def open_photons(path: str | Path, **overrides) -> Photons:
    """The photons, sensor and reference of a photon file (docs/photon-file.md).

    Args:
        path: an .npz photon file, or a .mat file as its authors published it.
        overrides: what the file does not say, or says wrongly: num_bins, bin_width_s, irf (array or path), irf_ref,
            toa_offset_bins, range_offset_m, gate (first bin, number of bins), fov_deg, rows, cols. They win over the
            sidecar FILE.json ("head.mat.json" for head.mat), which has the same names and wins over the file.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".npz", ".mat"):
        raise InvalidInput("photon file", str(path), "a file that ends in .npz or .mat")
    given = options.gather(path, overrides)
    if suffix == ".mat":
        return mat.read(path, given)
    return _override(npz.read(path), given)


def _override(photons: Photons, given: dict) -> Photons:
    """An npz file's photons with the options in place of what the file says."""
    for name in ("rows", "cols"):
        own = getattr(photons.sensor, name)
        if given.get(name, own) != own:
            raise InvalidInput(name, given[name], f"{own}, as in the file")
    photons = replace(photons, sensor=options.apply_to(photons.sensor, given))
    photons.frame.check(photons.sensor)
    return photons.gated(*given["gate"]) if "gate" in given else photons
