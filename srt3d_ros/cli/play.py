"""`srt3d play`: the player node with ordinary options, for a photon file, a bag or the simulator."""

import argparse

from srt3d_ros.cli import common, node

PARAMETERS = ("input", "rate_hz", "duration_s", "frames", "loop", "lossless", "output", "motion", "bag_rate",
              "bag_loop", "bag_start_s", "bag_stamps", "bag_photons_topic", "clock")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "play", help="publish photons over ROS 2, from a photon file, a bag or the simulator",
        description="Publish the photons of a file, of a bag, or of the simulator's moving scene, as a sensor's driver "
                    "would. What is left out keeps the default of the player node.")
    parser.add_argument("input", metavar="INPUT", help="photon file (docs/photon-file.md), a bag (its folder, "
                                                       ".mcap or .db3 file), or: simulator")
    parser.add_argument("--duration-s", type=float, metavar="S", help="stop after this time")
    parser.add_argument("--frames", type=int, metavar="N", help="stop after this many frames")
    parser.add_argument("--loop", action=argparse.BooleanOptionalAction,
                        help="begin again at the end (a file's one frame: yes; a bag: no)")
    parser.add_argument("--lossless", action="store_const", const=True,
                        help="wait for the pipeline instead of leaving frames behind")
    frames = parser.add_argument_group("files and the simulator")
    frames.add_argument("--rate-hz", type=float, metavar="HZ", help="frames a second")
    form = frames.add_mutually_exclusive_group()
    for topic, source in (("gates", "a SPAD array reads out"), ("histograms", "sensors send that count on the chip")):
        form.add_argument(f"--{topic}", dest="output", action="store_const", const=topic,
                          help=f"publish `{topic}`, as {source}, instead of `photons`")
    frames.add_argument("--motion", metavar="HOW",
                        help="walk, drone or spin: the simulator's sensor moves, and odom says where it is "
                             "(docs/motion.md)")
    bags = parser.add_argument_group("bags (docs/bags.md)")
    bags.add_argument("--rate", dest="bag_rate", type=float, metavar="X",
                      help="pace, 1 as recorded; 0 with --lossless: as fast as the pipeline answers")
    bags.add_argument("--start-s", dest="bag_start_s", type=float, metavar="S", help="begin this long after the start")
    bags.add_argument("--stamps", dest="bag_stamps", choices=("original", "now"),
                      help="as recorded, or as if the photons were acquired now")
    bags.add_argument("--photons-topic", dest="bag_photons_topic", metavar="TOPIC",
                      help="where the photons are, if the bag has several topics of them")
    bags.add_argument("--clock", action="store_const", const=True,
                      help="publish the bag's time on /clock, for nodes with use_sim_time")
    common.add_ros_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    args.bag_loop = args.loop       # one of the two is the input's
    return node.start_with_options("player", args, PARAMETERS)
