"""Photon files, laboratory files, bags and the simulator: all give a SensorModel and the photons of frames."""

from importlib import import_module
from pathlib import Path

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import BagFrames
from srt3d_ros.datasets.files import naming_file, read_text, readable, require_file
from srt3d_ros.datasets.photons import Photons, gather_options
from srt3d_ros.datasets.readers import histogram_logs
from srt3d_ros.datasets.stream import PhotonStream
from srt3d_ros.errors import require
from srt3d_ros.messages import sensor as sensor_message

__all__ = ["PhotonStream", "Photons", "open_photons", "open_sensor", "open_stream"]

# The module here that reads a photon file, by its suffix: `read(path, options)` gives Photons, or a Recording.
READERS = {".npz": "npz", ".mat": "mat", ".ptu": "ptu", ".sdt": "sdt", ".h5": "hdf5", ".hdf5": "hdf5",
           ".npy": "cubes"}
SUFFIXES = *READERS, *histogram_logs.SUFFIXES


def open_photons(path: str | Path, frame: int = 0, photons_topic: str = "", **overrides) -> Photons:
    """The photons, sensor and reference of a file (docs/photon-file.md), or of a frame of a bag (docs/bags.md).

    Args:
        path: an .npz photon file, a .mat file as its authors published it, a laboratory file (.ptu, .sdt, …), an array
            of counts, a log of histograms (.json, .gz), or a bag: its folder, .mcap or .db3 file.
        frame: which message of a bag's photons, or frame of a log, from 0; other files have one frame.
        photons_topic: the topic of a bag's photons, if it has several.
        overrides: what the file does not say, or says wrongly: num_bins, bin_width_s, irf (array or path), irf_ref,
            toa_offset_bins, range_offset_m, toa_reference, gate (first bin, number of bins), fov_deg, rows, cols,
            channel. They win over the sidecar FILE.json ("head.mat.json" for head.mat), which has the same names and
            wins over the file.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    photons = open_stream(path, frame, photons_topic, **overrides)
    return photons.read_whole() if isinstance(photons, PhotonStream) else photons


def open_stream(path: str | Path, frame: int = 0, photons_topic: str = "", guess_irf: bool = False,
                **overrides) -> Photons | PhotonStream:
    """As open_photons; of a laboratory file that has too many photons to keep, or fractional counts, a PhotonStream.

    Args:
        guess_irf: as for PhotonStream.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    with readable(path):
        if histogram_logs.is_log(path):
            return histogram_logs.read_frame(path, frame, gather_options(path, overrides))
        if reader is None:
            require(is_bag(path), "photon file", str(path), f"a file that ends in {', '.join(SUFFIXES)}, or a bag")
            with BagFrames(path, photons_topic) as frames:
                return frames.photons(frames.place(frame), overrides)
        options = gather_options(path, overrides)
        require(frame == 0, "frame", frame, "0: a photon file has one frame")
        require_file(path, "photon file")
        found = import_module(f"srt3d_ros.datasets.readers.{reader}").read(path, options)
        if isinstance(found, Photons):
            return found.with_options(options)
        stream = PhotonStream(found, options, guess_irf)
        return stream if stream.whole is None else stream.whole


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
