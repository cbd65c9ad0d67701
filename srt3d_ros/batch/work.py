"""What a process does for a batch: one frame, from the bag or log to its file."""

import secrets
from dataclasses import dataclass, field
from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.batch.request import Request
from srt3d_ros.batch.sources import BagSource, LogPlace, LogSource, open_source
from srt3d_ros.datasets.bag_photons import FramePlace
from srt3d_ros.errors import InvalidInput, require

VERSION = "version"         # what an error is about if a worker has another srt3d_ros


@dataclass(frozen=True)
class Task:
    """What all frames of a batch share.

    Args:
        request: what to do with each, with absolute paths.
        run: a name of this run: a process keeps the input open until one of another run comes.
        version: of srt3d_ros, which has to be the same everywhere.
    """

    request: Request
    run: str = field(default_factory=lambda: secrets.token_hex(8))
    version: str = __version__


@dataclass(frozen=True)
class Outcome:
    """What became of a frame: points in its file, notes on how they were made; or why there is none."""

    number: int
    points: int = 0
    notes: tuple[str, ...] = ()
    error: InvalidInput | None = None


_open: dict[str, BagSource | LogSource] = {}       # the last task's


def reconstruct_frame(task: Task, place: FramePlace | LogPlace, path: Path) -> Outcome:
    """Write the cloud of a frame to its file.

    Raises:
        ModuleNotFoundError: an optional package is missing here.
    """
    try:
        require(task.version == __version__, VERSION, __version__, f"srt3d_ros {task.version} in all processes")
        cloud = task.request.cloud(_source(task).read(place))
        cloud.save(path)
    except InvalidInput as error:
        return Outcome(place.number, error=error)
    except ModuleNotFoundError:
        raise
    except Exception as error:      # no frame must end the batch
        return Outcome(place.number, error=failure(error))
    return Outcome(place.number, len(cloud), cloud.notes)


def failure(error: Exception) -> InvalidInput:
    """What went wrong beside the input, in the words of an error about a frame."""
    return InvalidInput("reconstruction", f"failed ({type(error).__name__}: {error})", "a cloud")


def _source(task: Task) -> BagSource | LogSource:
    found = _open.get(task.run)
    if found is None:
        for other in _open.values():
            other.close()
        _open.clear()
        found = _open[task.run] = open_source(task.request)
    return found
