"""What a process does for a batch: one frame, from the bag or log that many are in to its file."""

import os
import secrets
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from srt3d_ros import __version__, api, devices
from srt3d_ros.batch.request import Request
from srt3d_ros.datasets.bag import is_bag
from srt3d_ros.datasets.bag_photons import BagFrames, FramePlace
from srt3d_ros.datasets.in_order import InOrder
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.results import Sketch

VERSION = "version"         # what an error is about if a worker has another srt3d_ros


class BagSource(BagFrames):
    """The frames of a bag, photons or sketches; InvalidInput if it cannot be read."""

    def __init__(self, request: Request):
        super().__init__(request.input, request.photons_topic)
        self._overrides = request.overrides

    @property
    def identity(self) -> dict[str, Any]:
        """What tells this input from another."""
        topic = self.topics.frames
        return _identity(self.path) | {"topic": topic.name, "messages": topic.messages,
                                       "first_ns": self.place(0).frame.time_ns}

    def read(self, place: FramePlace) -> Photons | Sketch:
        """A frame; InvalidInput if it cannot be read."""
        return api.open_frame(self, place, self._overrides)


class LogPlace(NamedTuple):
    """Where a frame of a log is."""

    number: int


class LogSource:
    """The frames of a device's log, which has no index: cheap to read in their order only."""

    def __init__(self, request: Request, device: devices.Device):
        def from_start() -> Iterator[Photons]:
            return devices.frames(request.input, device, **request.overrides)

        self.identity = _identity(request.input)
        self._frames = InOrder(from_start)
        self._length = sum(1 for _ in from_start())

    def __len__(self) -> int:
        return self._length

    def places(self, first: int) -> Iterator[LogPlace]:
        """Where the frames are, from `first` on."""
        return map(LogPlace, range(first, len(self)))

    def read(self, place: LogPlace) -> Photons:
        """A frame; InvalidInput if it cannot be read."""
        return self._frames[place.number]

    def close(self) -> None:
        """Nothing is open."""


def open_source(request: Request) -> BagSource | LogSource:
    """The frames of the request's input; InvalidInput if it has but one, or cannot be read."""
    if is_bag(request.input):
        return BagSource(request)
    device = devices.of_log(request.input)
    require(device is not None, "frames", request.input.name, "a bag or a device's log: other files have one frame")
    return LogSource(request, device)


def _identity(path: Path) -> dict[str, Any]:
    """The name of a file or folder and its size."""
    files = path.iterdir() if path.is_dir() else (path,)
    return {"name": path.name, "bytes": sum(os.path.getsize(file) for file in files)}


@dataclass(frozen=True)
class Task:
    """What all frames of a batch share.

    Args:
        request: what to do with each, with absolute paths.
        run: a name of this run: a process keeps the input open until one of another run comes.
        version: of srt3d_ros, which has to be the same everywhere.
    """

    request: Request = field(compare=False)
    run: str = field(default_factory=lambda: secrets.token_hex(8))
    version: str = __version__


@dataclass(frozen=True)
class Outcome:
    """What became of a frame: points in its file, notes on how they were made; or why there is none."""

    number: int
    points: int = 0
    notes: tuple[str, ...] = ()
    error: InvalidInput | None = None


def reconstruct_frame(task: Task, place: FramePlace | LogPlace, path: Path) -> Outcome:
    """Write the cloud of a frame to its file.

    Raises:
        ModuleNotFoundError: an optional package is missing here.
    """
    try:
        require(task.version == __version__, VERSION, __version__, f"srt3d_ros {task.version} in all processes")
        cloud = task.request.cloud(_source(task).read(place))
        cloud.save(path)
    except ModuleNotFoundError:
        raise
    except Exception as error:      # no frame must end the batch
        return Outcome(place.number, error=failure(error))
    return Outcome(place.number, len(cloud), cloud.notes)


def failure(error: Exception) -> InvalidInput:
    """An error about a frame: itself, or what went wrong beside the input."""
    if isinstance(error, InvalidInput):
        return error
    if isinstance(error, BrokenProcessPool):
        return InvalidInput("reconstruction", "ended by the system, twice", "memory enough: fewer --jobs take less")
    return InvalidInput("reconstruction", f"failed ({type(error).__name__}: {error})", "a cloud")


_open: dict["Task", "BagSource | LogSource"] = {}      # of this process: one at most


def _source(task: Task) -> BagSource | LogSource:
    """The input, open from frame to frame; that of an earlier run is closed."""
    if task not in _open:
        while _open:
            _open.popitem()[1].close()
        _open[task] = open_source(task.request)
    return _open[task]
