"""`srt3d reconstruct --frames`: each frame into a file of its own, one after the other."""

import argparse
import json
import os
import re
import sys
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.errors import InvalidInput, printable, require
from srt3d_ros.files.new_files import atomic_write, check_not_input, file_errors
from srt3d_ros.progress import progress

OPTIONS_FILE = "options.json"
OF_THE_RUN = ("output", "frame", "frames", "format", "json", "run")     # arguments that change no cloud
FAILED = 1


def run(args: argparse.Namespace, options: dict) -> int:
    """Reconstruct the frames that are not in the folder yet; `options` are those of api.reconstruct."""
    from srt3d_ros import api, datasets
    from srt3d_ros.datasets import cloud_files

    numbers = datasets.frame_numbers(args.input, args.frames, args.photons_topic, **common.overrides(args))
    require(args.frame == 0, "--frame", args.frame, "none beside --frames")
    cloud_files.check_format(Path(f"0.{args.format}"))
    folder = folder_for(args)
    there = set(os.listdir(folder))
    name_of = f"{{:06d}}.{args.format}".format
    left = [number for number in numbers if name_of(number) not in there]

    loaders = datasets.frame_loaders(args.input, left, args.photons_topic, **common.overrides(args)) if left else ()
    done, failed = 0, {}
    try:
        for _, (number, load) in zip(progress(range(len(left)), "reconstructing"), loaders):
            try:
                cloud = api.reconstruct(load(), **options)
                cloud.save(folder / name_of(number))
            except InvalidInput as error:
                if not done and [*failed.values()] == [str(error)]:     # so are the first two: an option is wrong
                    raise
                failed[str(number)] = str(error)
            except Exception as error:
                failed[str(number)] = printable(f"{type(error).__name__}: {error}")
            else:
                if not done:
                    common.print_notes(cloud.notes)
                done += 1
    except InvalidInput as error:       # also of a bag that breaks off
        if not done:
            raise
        rest = left[done + len(failed):]
        failed[f"{rest[0]} to {rest[-1]}"] = str(error)
    for number, error in failed.items():
        print(f"srt3d: frame {number}: {error}", file=sys.stderr)
    facts = {"frames": len(numbers), "reconstructed": done, "there": len(numbers) - len(left), "failed": failed,
             "output": str(args.output)}
    words = "{reconstructed:,} of {frames:,} frames reconstructed, {there:,} were there\n{output}"
    common.print_facts(args, facts, words.format(**facts))
    return FAILED if failed else 0


def folder_for(args: argparse.Namespace) -> Path:
    """The folder for the clouds, made if it is missing; InvalidInput if it has clouds of another input or options.

    OPTIONS_FILE keeps both.
    """
    folder = Path(args.output).absolute()
    check_not_input(folder, args.input)
    require(folder.is_dir() or not os.path.lexists(folder), "output",
            problem=f"{args.output} is a file: with --frames, give a folder.")
    arguments = vars(args) | {"input": os.path.abspath(args.input)}
    text = json.dumps({name: value for name, value in arguments.items() if name not in OF_THE_RUN}, indent=1)
    with file_errors("output", args.output):
        folder.mkdir(exist_ok=True)
        path = folder / OPTIONS_FILE
        if any(re.match(r"\d{6,}\.", name) for name in os.listdir(folder)):
            same = path.exists() and path.read_bytes() == text.encode()
            require(same, "output", problem=f"{args.output} has clouds of another input or of other options (see "
                    f"{OPTIONS_FILE} there): give another folder.")
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    return folder
