"""`srt3d play`: the player node with ordinary options, for a photon file or the simulator."""

import argparse

from srt3d_ros.cli import node

PARAMETERS = ("input", "rate_hz", "duration_s", "frames", "loop", "lossless", "output")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "play", help="publish photons over ROS 2, from a photon file or the simulator",
        description="Publish the photons of a file, or of the simulator's moving scene, as a sensor's driver would. "
                    "What is left out keeps the default of the player node.")
    parser.add_argument("input", metavar="INPUT", help="photon file (.npz, or .mat as published), or: simulator")
    parser.add_argument("--rate-hz", type=float, metavar="HZ", help="frames a second")
    parser.add_argument("--duration-s", type=float, metavar="S", help="stop after this time")
    parser.add_argument("--frames", type=int, metavar="N", help="stop after this many frames")
    parser.add_argument("--loop", action=argparse.BooleanOptionalAction, help="send a file's frame again and again")
    parser.add_argument("--lossless", action="store_const", const=True,
                        help="wait for the pipeline instead of leaving frames behind")
    parser.add_argument("--gates", dest="output", action="store_const", const="gates",
                        help="publish `gates`, as a SPAD array reads out, instead of `photons`")
    parser.add_argument("--ros-args", nargs=argparse.REMAINDER, default=[], metavar="…",
                        help="the rest goes to ROS 2: remapping, parameters, …")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    given = {name: getattr(args, name) for name in PARAMETERS if getattr(args, name) is not None}
    return node.start("player", [*node.parameter_arguments(given), *args.ros_args])
