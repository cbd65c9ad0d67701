"""Many frames of a bag or a log: which there are, and a function for each that reads it, in one pass."""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import FILE_READERS, SIMULATOR, read
from srt3d_ros.datasets.bags import frames
from srt3d_ros.datasets.bags.bag import Bag, is_bag
from srt3d_ros.datasets.options import gathered
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import require_file

MOST_FRAMES = 10**7         # at once: their numbers take 0.4 GB


def numbers(path: str | Path, wanted: str, photons_topic: str = "") -> range:
    """The frames of a file, bag or log that `wanted` names: "all", or the first and the last one such as "0-99".

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
            count = frames.find_photons(bag, photons_topic).frames.messages
    else:
        require_file(Path(path), "photon file")
        log = _log(path)
        count = 1 if log is None else sum(1 for _ in log.frames(Path(path), {}))
    first, last = map(int, ends.groups()) if ends else (0, count - 1)
    require(last - first < MOST_FRAMES, "--frames", problem=f"Give at most {MOST_FRAMES:,} frames at once.")
    fits = first <= last < count
    require(fits, "--frames", problem=f"{path} has no frames {first} to {last} (it has {count:,}).")
    return range(first, last + 1)


def loaders(path: str | Path, numbers: Sequence[int], photons_topic: str = "", *, sensor: SensorModel | None = None,
            **options: Any) -> Iterator[tuple[int, Callable[[], Reading]]]:
    """Yield each of the numbers, which ascend, and a function that gives what `read` gives for this frame.

    The functions can be pickled. Arguments and errors as for `read`; a function raises what is wrong with its frame.
    """
    given = gathered(options, sensor)
    if str(path) != SIMULATOR and is_bag(path):
        yield from frames.frames(path, numbers, given, photons_topic)
    elif log := _log(path):
        wanted = set(numbers)
        yield from (one for one in enumerate(log.frames(Path(path), given)) if one[0] in wanted)
    else:
        for number in numbers:
            yield number, partial(read, path, number, photons_topic, sensor=sensor, **options)


def _log(path: str | Path):
    """The module that reads several frames of a file, or None."""
    name = FILE_READERS.get(Path(path).suffix.lower())
    module = name and import_module(name, __package__)
    return module if hasattr(module, "frames") else None
