"""Photon files (npz, published .mat), bags and the simulator: all give a SensorModel and the photons of frames."""

from dataclasses import replace
from pathlib import Path

from srt3d_ros.datasets import mat, npz, options
from srt3d_ros.datasets.bag import is_bag
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require

__all__ = ["Photons", "open_photons"]


def open_photons(path: str | Path, frame: int = 0, photons_topic: str = "", **overrides) -> Photons:
    """The photons, sensor and reference of a photon file (docs/photon-file.md), or of a frame of a bag (docs/bags.md).

    Args:
        path: an .npz photon file, a .mat file as its authors published it, or a bag: its folder, .mcap or .db3 file.
        frame: which message of a bag's photons, from 0; files have one frame.
        photons_topic: the topic of a bag's photons, if it has several.
        overrides: what the file does not say, or says wrongly: num_bins, bin_width_s, irf (array or path), irf_ref,
            toa_offset_bins, range_offset_m, toa_reference, gate (first bin, number of bins), fov_deg, rows, cols. They
            win over the sidecar FILE.json ("head.mat.json" for head.mat), which has the same names and wins over the
            file.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    path = Path(path)
    try:
        return _open(path, frame, photons_topic, overrides)
    except OSError as error:
        raise InvalidInput("photon file", str(path), f"a file that can be read ({error.strerror or error})") from None


def _open(path: Path, frame: int, photons_topic: str, overrides: dict) -> Photons:
    suffix = path.suffix.lower()
    is_file = suffix in (".npz", ".mat")
    require(is_file or is_bag(path), "photon file", str(path), "a file that ends in .npz or .mat, or a bag")
    given = options.gather(path.absolute(), overrides)      # a bag may be the folder "."
    if is_file:
        require(frame == 0, "frame", frame, "0: a photon file has one frame")
        return mat.read(path, given) if suffix == ".mat" else _override(npz.read(path), given)
    from srt3d_ros.datasets import bag_photons  # here: messages and rosbags are of no use to files

    return _override(bag_photons.read_frame(path, frame, photons_topic), given)


def _override(photons: Photons, given: dict) -> Photons:
    """The photons of a file that describes its sensor, with the options in place of what it says."""
    for name in ("rows", "cols"):
        own = getattr(photons.sensor, name)
        if given.get(name, own) != own:
            raise InvalidInput(name, given[name], f"{own}, as in the file")
    photons = replace(photons, sensor=options.apply_to(photons.sensor, given))
    photons.frame.check(photons.sensor)
    return photons.gated(*given["gate"]) if "gate" in given else photons
