"""`srt3d bag-record`: the bag_recorder node with ordinary options."""

import argparse

from srt3d_ros.cli import common, node

PARAMETERS = ("path", "topics", "format", "max_duration_s", "max_size_mb")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "bag-record", help="record photons and their sensor, or other topics, in a ROS 2 bag",
        description="Record the photons and the description of their sensor, or other topics of the pipeline, in a bag "
                    "that `srt3d play`, `srt3d reconstruct` and `ros2 bag play` read (docs/bags.md). Ends with Ctrl-C. "
                    "What is left out keeps the default of the bag_recorder node.")
    parser.add_argument("path", metavar="OUT", help="the bag, a folder that is not there yet")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC",
                        help="what to record (photons gates histograms sensor); also sketch, sketch/sensor, points, …")
    parser.add_argument("--format", choices=("mcap", "sqlite3"), help="how rosbag2 stores it (mcap)")
    parser.add_argument("--max-duration", dest="max_duration_s", type=float, metavar="S", help="end after this time")
    parser.add_argument("--max-size", dest="max_size_mb", type=int, metavar="MB", help="end at this size")
    common.add_ros_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    args.topics = args.topics and ",".join(args.topics)
    return node.start_with_options("bag_recorder", args, PARAMETERS)
