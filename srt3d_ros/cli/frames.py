"""`srt3d reconstruct --frames`: each frame into a file of its own, one after the other."""

import argparse
import os
import sys
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.errors import InvalidInput, printable, require
from srt3d_ros.files.new_files import check_not_input, file_errors
from srt3d_ros.progress import progress

FAILED = 1


def run(args: argparse.Namespace, options: dict) -> int:
    """Reconstruct the frames into a folder; `options` are those of api.reconstruct."""
    from srt3d_ros import api, datasets
    from srt3d_ros.datasets import cloud_files

    numbers = datasets.frame_numbers(args.input, args.frames, args.photons_topic, **common.overrides(args))
    require(args.frame == 0, "--frame", args.frame, "none beside --frames")
    cloud_files.check_format(Path(f"0.{args.format}"))
    names = [f"{number:06d}.{args.format}" for number in numbers]
    folder = _folder(args, names)

    loaders = datasets.frame_loaders(args.input, numbers, args.photons_topic, **common.overrides(args))
    done, failed = 0, {}
    try:
        for k, (number, load) in zip(progress(range(len(numbers)), "reconstructing"), loaders):
            try:
                cloud = api.reconstruct(load(), **options)
                cloud.save(folder / names[k])
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
        failed[f"{numbers[done + len(failed)]} to {numbers[-1]}"] = str(error)
    for number, error in failed.items():
        print(f"srt3d: frame {number}: {error}", file=sys.stderr)
    facts = {"frames": len(numbers), "reconstructed": done, "failed": failed, "output": str(args.output)}
    common.print_facts(args, facts, "{reconstructed:,} of {frames:,} frames reconstructed\n{output}".format(**facts))
    return FAILED if failed else 0


def _folder(args: argparse.Namespace, names: list[str]) -> Path:
    """The folder for the clouds, made if it is missing; InvalidInput if one of these files is there."""
    from srt3d_ros.datasets.cloud_files import SUFFIXES

    folder = Path(args.output)
    check_not_input(folder, args.input)
    require(folder.suffix.lower() not in SUFFIXES or folder.is_dir(), "--output", args.output,
            "the name of a folder beside --frames; --format sets the suffix of its files")
    with file_errors("output", args.output):
        folder.mkdir(exist_ok=True)
        there = {*names} & {*os.listdir(folder)}
    require(not there, "output", problem=f"{args.output} has {len(there):,} of these files: give another folder, "
            "or other --frames.")
    return folder
