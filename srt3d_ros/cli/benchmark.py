"""`srt3d benchmark`: what this machine reaches, on one screen."""

import argparse

from srt3d_ros.cli.common import add_device


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "benchmark", help="time, memory and rates of this machine",
        description="Time the default method on frames of several sizes, and sketching in every form in which photons "
                    "come. It takes a minute.")
    add_device(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.benchmark import device_for, screen

    for line in screen(device_for(args.device)):
        print(line, flush=True)
    return 0
