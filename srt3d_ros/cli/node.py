"""`srt3d node NAME`: run a node in this process; `srt3d play`: run the player with ordinary options.

The executables in lib/srt3d_ros, which `ros2 run` starts, call `srt3d node`.
"""

import argparse
import importlib
import os
import signal
import sys

from srt3d_ros.processes.node_command import NODES, PLAYER, namespace_arguments, parameter_arguments

NO_PARAMETERS = ("run", "namespace", "ros_args")       # all other options are parameters of the player


def add_parser(subparsers) -> None:
    node = subparsers.add_parser(
        "node", help="run one ROS 2 node, as `ros2 run srt3d_ros NAME` does",
        description="Run one node until Ctrl-C, as `ros2 run srt3d_ros NAME` does. docs/nodes.md lists the topics and "
                    "parameters of each.", epilog="example: srt3d node sketcher --ros-args -p sketch_size:=5")
    node.add_argument("name", choices=NODES, metavar="NAME", help=", ".join(NODES))
    node.add_argument("ros_args", nargs=argparse.REMAINDER, metavar="--ros-args …",
                      help="all following arguments go to ROS 2: remappings, parameters, …")
    # REMAINDER also takes the --help after a name.
    node.set_defaults(run=lambda args: node.parse_args(["-h"]) if args.ros_args[:1] in (["-h"], ["--help"])
                      else start(args.name, args.ros_args))
    parser = subparsers.add_parser(
        "play", help="publish photons over ROS 2, from a photon file or the simulator",
        description="Publish the photons of a file again and again, or those of the simulator's moving scene, as a "
                    "sensor's driver does. Defaults: those of the player node.")
    parser.add_argument("input", metavar="INPUT", help="photon file (docs/photon-file.md), or: simulator")
    parser.add_argument("--frames", type=int, metavar="N", help="stop after this number of frames")
    parser.add_argument("--sensor-file", metavar="FILE", help="sensor description, for a photon file without a "
                        "complete one: JSON as on `sensor`, or another photon file")
    parser.add_argument("--rate-hz", type=float, metavar="HZ", help="frames per second")
    parser.add_argument("--motion", metavar="HOW",
                        help="walk: move the simulator's sensor and publish its pose on `odom` (docs/motion.md)")
    parser.add_argument("--namespace", metavar="NS", help="namespace of the node and its topics")
    parser.add_argument("--ros-args", nargs=argparse.REMAINDER, default=[], metavar="…",
                        help="all following arguments go to ROS 2: remappings, parameters, …")
    parser.set_defaults(run=_play)


def _play(args: argparse.Namespace) -> int:
    given = {key: value for key, value in vars(args).items() if value is not None and key not in NO_PARAMETERS}
    namespace = namespace_arguments(args.namespace) if args.namespace else []
    return start(PLAYER, [*parameter_arguments(given), *namespace, *args.ros_args])


def start(name: str, ros_args: list[str]) -> int:
    """Run a node in this process until it ends; returns its exit code."""
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
