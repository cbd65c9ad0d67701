"""Read photon files, published data, bags and the simulator: all give a `Reading`, a frame with its sensor."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.arrays import with_options
from srt3d_ros.datasets.bags import frames as bag_frames
from srt3d_ros.datasets.bags.bag import Bag, is_bag
from srt3d_ros.datasets.irf import tail_note
from srt3d_ros.datasets.named_arrays import reading_of
from srt3d_ros.datasets.options import Options, SensorOptions, gathered
from srt3d_ros.datasets.readers import csv_lists, hdf5, histograms, mat, npz, ptu, tmf8829, tttr
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.files import json_text
from srt3d_ros.files.array_files import read_errors, require_file
from srt3d_ros.files.new_files import file_errors
from srt3d_ros.messages import sensor_message

SIMULATOR = "simulator"     # in place of a path
# Functions by suffix, of path and options (options.gathered), that give the named arrays of a file. They raise
# InvalidInput, naming the file and what in it cannot be used. Those of LOGS yield a function for each frame.
FILE_READERS = {".npz": npz.read, ".npy": npz.read_npy, ".mat": mat.read, ".csv": csv_lists.read, ".ptu": ptu.read,
                ".sdt": histograms.read, ".phu": histograms.read,
                **dict.fromkeys((".spc", ".pt3", ".ht3"), tttr.read),
                **dict.fromkeys((".h5", ".hdf5", ".hdf", ".nc"), hdf5.read)}
# What to do with files that are not read, by suffix.
CONVERTERS = {
    **dict.fromkeys((".pt2", ".ht2", ".t2r", ".t3r"), "PicoQuant's software and tttrlib convert it to .ptu"),
    **dict.fromkeys((".phd", ".hhd", ".thd"), "PicoQuant's software exports it as text, which --irf takes; counts of a "
                                              "scene are read as .npy [rows, cols, bins]"),
    **dict.fromkeys((".txt", ".dat", ".asc"), "Text is an --irf, or a .csv whose first line names row, col and toa"),
    ".ttbin": "TimeTagger.FileReader of Swabian's package reads it: give row, col and toa to srt3d_ros.from_events",
    ".set": "It is the setup of a measurement: give the .spc or .sdt file"}
LOGS = {".json": tmf8829.frames, ".gz": tmf8829.frames}
MOST_FRAMES = 10**7         # at once: their numbers take 0.4 GB


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
    chosen = gathered(options, sensor, guess_irf)
    with file_errors("photon file", path, "read"), closing(_frames(path, (frame,), chosen, photons_topic, sensor)
                                                           ) as frames:
        return next(frames)[1]()


def read_photons(path: str | Path, *arguments: Any, **options: Any) -> Reading:
    """`read`, for those that need photons: InvalidInput for a sketch or a cloud."""
    reading = read(path, *arguments, **options)
    what = "sketch" if isinstance(reading.frame, PhaseSums) else "cloud"
    require(isinstance(reading.frame, PhotonEvents | PhotonHistograms), "photon file",
            problem=f"{path} holds a {what}, no photons.")
    return reading


def _frames(source: str | Path, numbers: Sequence[int], options: Options, photons_topic: str,
            sensor: SensorModel | None) -> Iterator[tuple[int, Callable[[], Reading]]]:
    """Yield each of the numbers, and a function that reads this frame; logs and bags are read once."""
    path, suffix, suffixes = Path(source), Path(source).suffix.lower(), FILE_READERS | LOGS
    if str(source) != SIMULATOR and suffix not in suffixes and is_bag(path):
        yield from bag_frames.frames(path, numbers, options, photons_topic)
        return
    require(not photons_topic, "photons_topic", problem="Only bags have topics.")
    require(min(numbers) >= 0, "frame", min(numbers), "0 or more")
    if str(source) == SIMULATOR:
        yield from ((number, partial(_simulated, number, sensor, options)) for number in numbers)
        return
    if suffix not in suffixes:
        require(path.exists(), "photon file", problem=f"{path}: no such file.")
        require(suffix not in CONVERTERS, "photon file", problem=f"{path.name}: {CONVERTERS.get(suffix)}.")
        raise InvalidInput("photon file", str(path), f"a file that ends in {', '.join(suffixes)}, or a bag")
    require_file(path, "photon file")
    if suffix in FILE_READERS:
        yield from ((number, partial(_of_file, path, number, options)) for number in numbers)
        return
    count, wanted = 0, {*numbers}
    for count, load in enumerate(LOGS[suffix](path, options), start=1):
        if count - 1 in wanted:
            yield count - 1, load
    raise InvalidInput("frame", problem=f"{path.name} has no frame {max(wanted)} (it has {count}).")


def _of_file(path: Path, frame: int, options: Options) -> Reading:
    """Frame `frame` of a file; InvalidInput if it has fewer."""
    later = options.without("reversed", "gate") if options.reversed else options      # a gate counts after that
    with file_errors("photon file", path, "read"):
        reading = reading_of(path, FILE_READERS[path.suffix.lower()](path, replace(later, frame=frame, reversed=None)))
    require(frame < reading.frames, "frame", frame, f"0, the only frame of {path.name}")
    if options.reversed:
        reading = reading.reversed()
        reading = reading.gated(*options.gate) if options.gate else reading
    return replace(reading, notes=(*reading.notes, *tail_note(reading.sensor)))


def _simulated(frame: int, sensor: SensorModel | None, options: Options) -> Reading:
    """A frame of the head with its true depths, as this sensor sees it: 10 photons a pixel, half of them background."""
    simulator = Simulator(sensor=sensor)
    events, depth_bins = simulator.frame(frame)
    return with_options(Reading(simulator.sensor, events, depth_bins, SIMULATOR), options)


def frame_numbers(path: str | Path, wanted: str, photons_topic: str = "", **options: Any) -> range:
    """The frames of a file, bag or log that `wanted` names: "all", or the first and the last one such as "0-99".

    `options` are those of `read`, which say which array has them.

    Raises:
        InvalidInput: it has no such frames, or cannot be read; or all are wanted of the simulator, which has no end.
    """
    ends = re.fullmatch(r"(\d{1,9})[-:](\d{1,9})", wanted)
    require(ends or wanted == "all", "--frames", wanted, "all, or first and last frame such as 0-99")
    if str(path) == SIMULATOR:
        require(ends, "--frames", wanted, f"first and last frame such as 0-99: {path} has no end")
        count = 10**9       # frame numbers of nine digits
    elif is_bag(path):
        with Bag(path) as bag:
            count = bag_frames.find_photons(bag, photons_topic).frames.messages
    else:
        require_file(Path(path), "photon file")
        log = LOGS.get(Path(path).suffix.lower())
        count = sum(1 for _ in log(Path(path), Options())) if log else read(path, guess_irf=True, **options).frames
    first, last = map(int, ends.groups()) if ends else (0, count - 1)
    require(last - first < MOST_FRAMES, "--frames", problem=f"Give at most {MOST_FRAMES:,} frames at once.")
    fits = first <= last < count
    require(fits, "--frames", problem=f"{path} has no frames {first} to {last} (it has {count:,}).")
    return range(first, last + 1)


def frame_loaders(path: str | Path, numbers: Sequence[int], photons_topic: str = "", *,
                  sensor: SensorModel | None = None, **options: Any) -> Iterator[tuple[int, Callable[[], Reading]]]:
    """Each of the numbers, which ascend, and a function that gives what `read` gives for this frame, in one pass.

    Arguments and errors as for `read`; a function raises what is wrong with its frame.
    """
    return _frames(path, numbers, gathered(options, sensor), photons_topic, sensor)


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
