"""`srt3d node NAME`: run one node. The executables in lib/srt3d_ros, which `ros2 run` starts, call this."""

import argparse
import importlib
import sys

NODES = ("player", "sketcher", "reconstructor", "recorder")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("node", help="run one ROS 2 node, as `ros2 run srt3d_ros NAME` does")
    parser.add_argument("name", choices=NODES)
    parser.add_argument("ros_args", nargs=argparse.REMAINDER, metavar="--ros-args …", help="arguments for ROS 2")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    sys.argv = [args.name, *args.ros_args]
    return importlib.import_module(f"srt3d_ros.nodes.{args.name}").main() or 0
