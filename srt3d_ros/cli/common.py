"""What several sub-commands have in common: options, and how results are printed."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable


def given(args: argparse.Namespace, names: Iterable[str]) -> dict[str, object]:
    """The options of these names that were given, by name."""
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


def comma_list(kind: Callable, expected: str, count: int | None = None) -> Callable[[str], tuple]:
    """A parser of an option's value: `count` values, or any number of them, with commas between."""
    def parse(text: str) -> tuple:
        try:
            values = tuple(kind(part) for part in text.split(","))
        except ValueError:
            values = None
        if values is None or count not in (None, len(values)):
            raise argparse.ArgumentTypeError(f"{text}: expected {expected}")
        return values
    return parse


def add_device(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"),
                        help="where to compute (auto: the GPU if there is one)")


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one line of JSON instead of words")


def add_ros_options(parser: argparse.ArgumentParser) -> None:
    """--namespace, and --ros-args, which takes the rest of the line."""
    parser.add_argument("--namespace", metavar="NS", help="of the node and its topics")
    parser.add_argument("--ros-args", nargs=argparse.REMAINDER, default=[], metavar="…",
                        help="the rest goes to ROS 2: remapping, parameters, …")


def print_notes(notes: Iterable[str]) -> None:
    """Print what the user should know beside the result, on stderr."""
    for note in notes:
        print(f"srt3d: {note}", file=sys.stderr)


def print_facts(args: argparse.Namespace, facts: dict, words: str) -> None:
    """Print the facts as JSON with --json, else in `words`, a format of them."""
    print(json.dumps(facts) if args.json else words.format(**facts))
