"""`srt3d reconstruct --frames`: each frame of a bag or log to a file."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tqdm import tqdm

from srt3d_ros import api
from srt3d_ros.datasets import readers
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import BagFrames
from srt3d_ros.datasets.options import gathered
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import file_errors
from srt3d_ros.recording import cloud_files

PROGRESS_S = 0.1 if sys.stderr.isatty() else 10.0       # between two lines of progress in a log


def reconstruct_frames(path: Path, photons_topic: str, overrides: dict, options: dict, folder: Path, suffix: str
                       ) -> dict:
    """Reconstruct all frames into a folder, but those whose file is there; each by itself, whatever was done before.

    Args:
        path, photons_topic, overrides: of a bag or log, as of `srt3d_ros.read`.
        options: of `srt3d_ros.reconstruct`.
        folder, suffix: of the files.

    Returns:
        What became of them: how many frames, of which earlier, done and failed; points; notes.

    Raises:
        InvalidInput: an option, the input or the folder cannot be used, or the first frame fails.
    """
    with _frames(path, photons_topic, gathered(overrides, path=path.absolute())) as (length, frames):
        files = [folder / f"frame_{number:06d}.{suffix}" for number in range(length)]
        with file_errors("output", folder):
            folder.mkdir(parents=True, exist_ok=True)
        cloud_files.check(folder / f"frame.{suffix}")
        found = {"frames": length, "earlier": sum(file.exists() for file in files), "done": 0, "failed": 0, "points": 0,
                 "notes": ()}
        with tqdm(total=length, initial=found["earlier"], unit="frame", mininterval=PROGRESS_S) as bar:
            for number, read in frames:
                if files[number].exists():
                    continue
                try:
                    cloud = api.reconstruct(read(), **options)
                    cloud.save(files[number])
                    found.update(done=found["done"] + 1, points=found["points"] + len(cloud), notes=cloud.notes)
                except InvalidInput as error:
                    if found["done"] + found["earlier"] == 0:       # an option, say, that is wrong for all frames
                        raise
                    found["failed"] += 1
                    tqdm.write(f"srt3d: frame {number}: {error}", file=sys.stderr)
                bar.update()
    return found


@contextmanager
def _frames(path: Path, photons_topic: str, options: dict) -> Iterator[tuple]:
    """How many frames the input has, and in their order the number of each with a function that reads it."""
    if is_bag(path):
        with BagFrames(path, photons_topic) as bag:
            yield len(bag), ((frame.number, partial(bag.read, frame, options)) for frame in bag)
        return
    module = readers.module_of(path)
    require(hasattr(module, "frames"), "frames", path.name, "a bag or log of histograms: other files have one frame")
    frames = list(module.frames(path, options))
    yield len(frames), enumerate(partial(frames.__getitem__, number) for number in range(len(frames)))
