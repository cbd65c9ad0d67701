"""`srt3d node NAME`: run one node. The executables in lib/srt3d_ros, which `ros2 run` starts, call this."""

import argparse
import importlib
import os
import re
import signal
import sys

from srt3d_ros.cli.common import given
from srt3d_ros.errors import require
from srt3d_ros.node_names import NODES
from srt3d_ros.processes import parameter_arguments


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("node", help="run one ROS 2 node, as `ros2 run srt3d_ros NAME` does")
    parser.add_argument("name", choices=NODES)
    parser.add_argument("ros_args", nargs=argparse.REMAINDER, metavar="--ros-args …", help="arguments for ROS 2")
    parser.set_defaults(run=lambda args: start(args.name, args.ros_args))


def exit_at_once_on_signals() -> None:
    """Exit on SIGINT and SIGTERM while modules are imported, until the nodes set handlers of their own.

    Nothing needs an orderly end yet, and KeyboardInterrupt in an extension module's import can become any exception.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))


def start(name: str, ros_args: list[str]) -> int:
    """Run a node in this process until it ends; returns its exit code."""
    exit_at_once_on_signals()
    # Read when NumPy is loaded. Its threads wait for each other at work: beside other processes a product of matrices
    # took up to 12 times the CPU time with two of them, and alone four fifths of the time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.argv = [name, *ros_args]
    return importlib.import_module(f"srt3d_ros.nodes.{name}").main()


def start_with_options(name: str, args: argparse.Namespace, parameters: tuple[str, ...]) -> int:
    """`start` with those of these parameters that were given as options, --namespace and --ros-args."""
    namespace = namespace_arguments(args.namespace) if args.namespace else []
    return start(name, [*parameter_arguments(given(args, parameters)), *namespace, *args.ros_args])


def namespace_arguments(namespace: str) -> list[str]:
    """A namespace as arguments of ROS 2, after `--ros-args`; InvalidInput if it cannot be one."""
    plain = namespace.strip("/")
    require(re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", plain, re.ASCII), "--namespace", namespace,
            "letters, digits and _, beginning with a letter, with / between")
    return ["-r", f"__ns:=/{plain}"]
