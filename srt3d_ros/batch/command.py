"""`srt3d reconstruct --frames`: from options to a folder of clouds, where it stopped if it was begun before."""

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from functools import partial
from pathlib import Path

from tqdm import tqdm

from srt3d_ros import __version__
from srt3d_ros.batch.executors import DaskCluster, LocalProcesses, done
from srt3d_ros.batch.folder import Folder
from srt3d_ros.batch.request import Request
from srt3d_ros.batch.work import VERSION, BagSource, LogSource, Outcome, Task, failure, open_source, reconstruct_frame
from srt3d_ros.errors import InvalidInput, require

ALL = "all"
ALWAYS_ALIKE = ("output", "bag", "irf", VERSION)      # errors about these: every frame has them
PROGRESS_S = 10.0           # between two lines of progress in a log; on a terminal it moves all the time


@dataclasses.dataclass
class Summary:
    """What became of the frames."""

    frames: int
    earlier: int = 0
    done: int = 0
    failed: int = 0
    points: int = 0
    notes: tuple[str, ...] = ()


def reconstruct_frames(request: Request, args: argparse.Namespace) -> Summary:
    """Reconstruct the frames `args.frames` into the folder `args.output`.

    Raises:
        InvalidInput: an option, the input or the folder cannot be used, or the input breaks off.
    """
    source = open_source(request)
    try:
        first, last = _range(args.frames, len(source))
        suffix = args.format or "npz"
        folder = Folder(Path(args.output).absolute(), f".{suffix}", _made(request, source, suffix))
        request = dataclasses.replace(request, input=request.input.absolute(), dark=_absolute(request.dark),
                                      overrides={name: _absolute(value) if name == "irf" else value
                                                 for name, value in request.overrides.items()})
        summary = Summary(last - first + 1)
        summary.earlier = sum(folder.file(number).exists() for number in range(first, last + 1))
        if summary.earlier < summary.frames:
            _run(request, source, folder, range(first, last + 1), summary, args)
        folder.sweep()
        return summary
    finally:
        source.close()


def _run(request: Request, source: BagSource | LogSource, folder: Folder, numbers: range, summary: Summary,
         args: argparse.Namespace) -> None:
    jobs = min(args.jobs or 1, summary.frames - summary.earlier)
    executor = LocalProcesses(jobs, _say) if args.dask is None else DaskCluster(args.dask, _say)
    options = {*ALWAYS_ALIKE, "dark", "method", *request.options, *request.overrides}
    try:
        with tqdm(total=summary.frames, initial=summary.earlier, unit="frame",
                  mininterval=0.1 if sys.stderr.isatty() else PROGRESS_S) as bar:
            for call, future in done(_calls(Task(request), source, folder, numbers), executor):
                outcome = _outcome(call, future)
                error = outcome.error
                if error is None:
                    summary.notes = summary.notes or outcome.notes
                    summary.done += 1
                    summary.points += outcome.points
                elif error.field in (options if summary.done + summary.earlier == 0 else ALWAYS_ALIKE):
                    raise error
                else:
                    summary.failed += 1
                    _say(f"frame {outcome.number}: {error}")
                bar.update()
    except CancelledError:
        raise InvalidInput("dask", args.dask, "a scheduler that stays; the same command goes on") from None
    finally:
        executor.close()


def _calls(task: Task, source: BagSource | LogSource, folder: Folder, numbers: range) -> Iterator[partial[Outcome]]:
    """What is to be done for the frames that have no file yet."""
    for place in source.places(numbers.start):
        if place.number not in numbers:
            return
        file = folder.file(place.number)
        if not file.exists():
            yield partial(reconstruct_frame, task, place, file)


def _outcome(call: partial[Outcome], future: Future) -> Outcome:
    try:
        return future.result()
    except (CancelledError, ModuleNotFoundError):
        raise
    except Exception as error:      # its process died, twice
        return Outcome(call.args[1].number, error=failure(error))


def _range(frames: str, length: int) -> tuple[int, int]:
    """The first and the last frame of "all" or FIRST:LAST."""
    if frames == ALL:
        return 0, length - 1
    first, mark, last = frames.partition(":")
    numbers = (int(first), int(last)) if mark and first.isdecimal() and last.isdecimal() else (-1, -1)
    require(0 <= numbers[0] <= numbers[1] < length, "frames", frames,
            f"{ALL}, or first and last such as 0:{length - 1}, the last there is")
    return numbers


def _made(request: Request, source: BagSource | LogSource, suffix: str) -> dict:
    """What the files depend on, by name."""
    given = request.overrides | request.options | {"dark": request.dark, "surface_order": request.surface_order}
    return {"srt3d_ros": __version__, "input": source.identity, "format": suffix,
            **{name: value for name, value in given.items() if value is not None}}


def _absolute(path: str | None) -> str | None:
    return None if path is None else str(Path(path).absolute())


def _say(line: str) -> None:
    tqdm.write(f"srt3d: {line}", file=sys.stderr)
