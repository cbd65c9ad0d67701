"""`srt3d node NAME`: run a node in this process; the executables that `ros2 run` starts call it."""

import argparse
import importlib
import json
import os
import signal
import sys
import textwrap

from srt3d_ros.processes.node_command import NODES


def add_parser(subparsers) -> None:
    node = subparsers.add_parser(
        "node",
        description="Run one node until Ctrl-C, as `ros2 run srt3d_ros NAME` does. NAME --help lists its parameters.",
        epilog="example: srt3d node sketcher --ros-args -p sketch_size:=5")
    node.add_argument("name", choices=NODES, metavar="NAME", help=", ".join(NODES))
    node.add_argument("ros_args", nargs=argparse.REMAINDER, metavar="--ros-args …",
                      help="all following arguments go to ROS 2: remappings, parameters, …")
    # REMAINDER also takes the --help after a name.
    node.set_defaults(run=lambda args: _help(args.name) if args.ros_args[:1] in (["-h"], ["--help"])
                      else start(args.name, args.ros_args))


def _help(name: str) -> int:
    """Print the topics and parameters of a node."""
    spec = importlib.import_module(f"srt3d_ros.nodes.{name}").SPEC
    print(f"usage: ros2 run srt3d_ros {name} [--ros-args -p PARAMETER:=VALUE -r TOPIC:=NAME …]\n\n"
          f"reads      {', '.join(topic.name for topic in spec.inputs)}\n"
          f"publishes  {', '.join(topic.name for topic in spec.outputs) or 'nothing'}\n\n"
          "parameters with their defaults (live: can be set while the node runs; inactive: while it is deactivated):")
    for one in spec.table:
        expected = ", ".join(filter(None, (one.expected, one.when)))
        print(f"\n  {one.name}:={json.dumps(one.default)}  ({expected})")
        print(textwrap.indent(textwrap.fill(one.description, 100), 6 * " "))
    return 0


def start(name: str, ros_args: list[str]) -> int:
    """Call `main` of a node's module in this process, and return the exit code that it returns."""
    exit_at_once_on_signals()
    # Read when NumPy is loaded. Threads of OpenBLAS wait for each other busily: with two, a matrix product took four
    # fifths of the time alone, but up to 12 times the CPU time next to other processes.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.argv = [name, *ros_args]
    return importlib.import_module(f"srt3d_ros.nodes.{name}").main()


def exit_at_once_on_signals() -> None:
    """Let SIGINT and SIGTERM end the process at once until the node sets handlers of its own.

    Python's handlers only run between two bytecodes, not while a library waits or compiles, and KeyboardInterrupt in
    the import of an extension module can become any exception.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
