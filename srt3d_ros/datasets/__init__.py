"""Read photon files, published data, bags and the simulator: all give a `Reading`, a frame with its sensor."""

from importlib import import_module
from pathlib import Path
from typing import Any, Unpack

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import read_frame
from srt3d_ros.datasets.options import SensorOptions, gathered
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.files import json_text
from srt3d_ros.files.array_files import read_errors, require_file
from srt3d_ros.files.new_files import file_errors
from srt3d_ros.messages import sensor_message

__all__ = ["SIMULATOR", "Reading", "open_sensor", "read", "read_photons"]

SIMULATOR = "simulator"     # in place of a path
# Modules by suffix. `read(path, options)` gives a Reading, `frames(path, options)` a function for each frame that gives
# them; options as from options.gathered, with `guess_irf`. They raise InvalidInput, naming the file and what in it
# cannot be used.
FILE_READERS = {".npz": ".readers.npz", ".mat": ".readers.mat", ".ptu": ".readers.ptu", ".npy": ".readers.cubes",
                ".h5": ".readers.hdf5", ".hdf5": ".readers.hdf5", ".hdf": ".readers.hdf5", ".sdt": ".readers.sdt",
                ".json": ".readers.tmf8829", ".gz": ".readers.tmf8829"}


def read(path: str | Path, frame: int = 0, photons_topic: str = "", *, sensor: SensorModel | None = None,
         guess_irf: bool = False, **options: Unpack[SensorOptions]) -> Reading:
    """Photons of a file, photons or a sketch of a frame of a bag, or what `save` wrote.

    Args:
        path: or "simulator" for its moving head.
        guess_irf: if the file has no IRF and none can be estimated, use one bin instead of raising InvalidInput.
        frame, photons_topic, sensor, options: as for `srt3d_ros.read`.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    require(isinstance(frame, int), "frame", quoted(frame), "an integer")
    if str(path) == SIMULATOR:
        return _simulated(frame, sensor, gathered(options))
    path = Path(path)
    with file_errors("photon file", path, "read"):
        options = gathered(options, sensor)
        if path.suffix.lower() not in FILE_READERS:
            require(is_bag(path) or path.exists(), "photon file", problem=f"{path}: no such file.")
            require(is_bag(path), "photon file", str(path), f"a file that ends in {', '.join(FILE_READERS)}, or a bag")
            return read_frame(path, frame, options, photons_topic)
        require(not photons_topic, "photons_topic", problem="Only bags have topics.")
        require_file(path, "photon file")
        return _of_file(path, frame, options | {"guess_irf": guess_irf})


def read_photons(path: str | Path, *arguments: Any, **options: Any) -> Reading:
    """`read`, for those that need photons: InvalidInput for a sketch or a cloud."""
    reading = read(path, *arguments, **options)
    what = "sketch" if isinstance(reading.frame, PhaseSums) else "cloud"
    require(isinstance(reading.frame, PhotonEvents | PhotonHistograms), "photon file",
            problem=f"{path} holds a {what}, no photons.")
    return reading


def _of_file(path: Path, frame: int, options: dict) -> Reading:
    """Frame `frame` of a file; InvalidInput if it has fewer."""
    module = import_module(FILE_READERS[path.suffix.lower()], __name__)
    if not hasattr(module, "frames"):
        require(frame == 0, "frame", frame, f"0, the only frame of {path.name}")
        return module.read(path, options)
    require(frame >= 0, "frame", frame, "0 or more")
    count = 0
    for count, found in enumerate(module.frames(path, options), start=1):
        if count > frame:
            return found()
    raise InvalidInput("frame", problem=f"{path.name} has no frame {frame} (it has {count}).")


def _simulated(frame: int, sensor: SensorModel | None, options: dict) -> Reading:
    """A frame of the head with its true depths, as this sensor sees it: 10 photons a pixel, half of them background."""
    require(frame >= 0, "frame", frame, "0 or more")
    simulator = Simulator(sensor=sensor)
    events, depth_bins = simulator.frame(frame)
    return Reading(simulator.sensor, events, depth_bins, SIMULATOR).with_options(options)


def open_sensor(path: str | Path) -> SensorModel:
    """The sensor from a .json file, in the format of the `sensor` topic (config/sensors/), or from what `read` takes.

    Raises:
        InvalidInput: one line that names the file and field that cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        return read(path).sensor
    require_file(path, "sensor file")
    with read_errors(path, "JSON in UTF-8"):
        size = path.stat().st_size
        require(size <= json_text.MAX_JSON_BYTES, "", f"{size} bytes", f"at most {json_text.MAX_JSON_BYTES} bytes")
        return sensor_message.from_json(path.read_text(encoding="utf-8-sig"))
