"""Photon files (npz, published .mat), bags and the simulator: all give a SensorModel and the photons of frames."""

from pathlib import Path

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import bag_photons, mat, npz
from srt3d_ros.datasets.bag import is_bag
from srt3d_ros.datasets.files import naming_file, read_text, require_file
from srt3d_ros.datasets.photons import Photons, gather_options
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import sensor as sensor_message

__all__ = ["Photons", "open_photons", "open_sensor"]


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
    options = gather_options(path.absolute(), overrides)        # a bag may be the folder "."
    require(not is_file or frame == 0, "frame", frame, "0: a photon file has one frame")
    if suffix == ".mat":
        return mat.read(path, options)
    photons = npz.read(path) if is_file else bag_photons.read_frame(path, frame, photons_topic)
    return photons.with_options(options)


def open_sensor(path: str | Path) -> SensorModel:
    """The sensor in a .json file, as on the `sensor` topic (config/sensors/ has some), or that of a photon file.

    Args:
        path: .json, or anything that `open_photons` opens, with its sidecar.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        return open_photons(path).sensor
    require_file(path, "sensor file")
    text = read_text(path)
    with naming_file(path):
        return sensor_message.from_json(text)
