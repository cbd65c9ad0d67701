"""`srt3d node NAME`: run one node. The executables in lib/srt3d_ros, which `ros2 run` starts, call this."""

import argparse
import importlib
import os
import re
import signal
import sys

from srt3d_ros.errors import require
from srt3d_ros.node_names import NODES


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("node", help="run one ROS 2 node, as `ros2 run srt3d_ros NAME` does")
    parser.add_argument("name", choices=NODES)
    parser.add_argument("ros_args", nargs=argparse.REMAINDER, metavar="--ros-args …", help="arguments for ROS 2")
    parser.set_defaults(run=lambda args: start(args.name, args.ros_args))


def leave_at_once_on_signals() -> None:
    """Until the nodes set handlers of their own, while their modules are imported, which takes seconds.

    Nothing has begun that would need an orderly end, and an exception in the middle of an extension module's import can
    become any other.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def start(name: str, ros_args: list[str]) -> int:
    """Run a node in this process until it ends; returns its exit code."""
    leave_at_once_on_signals()
    sys.argv = [name, *ros_args]
    return importlib.import_module(f"srt3d_ros.nodes.{name}").main()


def namespace_arguments(namespace: str) -> list[str]:
    """A namespace as arguments of ROS 2, after `--ros-args`; InvalidInput if it cannot be one."""
    plain = namespace.strip("/")
    require(re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", plain, re.ASCII), "--namespace", namespace,
            "letters, digits and _, beginning with a letter, with / between")
    return ["-r", f"__ns:=/{plain}"]
