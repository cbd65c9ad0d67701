"""Where many frames are: in a bag, or in the log of a device; each is read by itself, in any order."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from srt3d_ros import api, devices
from srt3d_ros.batch.request import Request
from srt3d_ros.datasets.bag import is_bag
from srt3d_ros.datasets.bag_photons import BagFrames, FramePlace
from srt3d_ros.datasets.in_order import InOrder
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import require
from srt3d_ros.results import Sketch


class LogPlace(NamedTuple):
    """Where a frame of a log is."""

    number: int


class BagSource:
    """The frames of a bag, photons or sketches; InvalidInput if it cannot be read."""

    def __init__(self, request: Request):
        self._frames, self._overrides = BagFrames(request.input, request.photons_topic), request.overrides

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def identity(self) -> dict[str, Any]:
        """What tells this input from another."""
        topic = self._frames.topics.frames
        return {"name": self._frames.path.name, "bytes": _size(self._frames.path), "topic": topic.name,
                "messages": topic.messages, "first_ns": self._frames.place(0).frame.time_ns}

    def places(self, first: int) -> Iterator[FramePlace]:
        """Where the frames are, from `first` on."""
        return self._frames.places(first)

    def read(self, place: FramePlace) -> Photons | Sketch:
        """A frame; InvalidInput if it cannot be read."""
        return api.open_frame(self._frames, place, self._overrides)

    def close(self) -> None:
        self._frames.close()


class LogSource:
    """The frames of a device's log, which has no index: cheap to read in their order only."""

    def __init__(self, request: Request, device: devices.Device):
        self._path, self._device, self._overrides = request.input, device, request.overrides
        self._frames = InOrder(self._from_start)
        self._length = sum(1 for _ in self._from_start())

    def __len__(self) -> int:
        return self._length

    @property
    def identity(self) -> dict[str, Any]:
        """What tells this input from another."""
        return {"name": self._path.name, "bytes": _size(self._path)}

    def places(self, first: int) -> Iterator[LogPlace]:
        """Where the frames are, from `first` on."""
        return map(LogPlace, range(first, len(self)))

    def read(self, place: LogPlace) -> Photons:
        """A frame; InvalidInput if it cannot be read."""
        return self._frames[place.number]

    def close(self) -> None:
        """Nothing is open."""

    def _from_start(self) -> Iterator[Photons]:
        return devices.frames(self._path, self._device, **self._overrides)


def open_source(request: Request) -> BagSource | LogSource:
    """The frames of the request's input; InvalidInput if it has but one, or cannot be read."""
    if is_bag(request.input):
        return BagSource(request)
    device = devices.of_log(request.input)
    require(device is not None, "frames", request.input.name, "a bag or a device's log: other files have one frame")
    return LogSource(request, device)


def _size(path: Path) -> int:
    """Bytes of a file, or of those in a folder."""
    return sum(os.path.getsize(file) for file in (path.iterdir() if path.is_dir() else (path,)))
