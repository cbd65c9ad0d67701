"""`srt3d device`: the device node with ordinary options."""

from srt3d_ros.cli import common, node

PARAMETERS = ("device", "connect", "log", "rate_hz", "frame_id")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "device", help="publish the histograms of a sensor, or of its log, over ROS 2",
        description="Publish `sensor` and `histograms` of a sensor in its own format (`srt3d devices` lists them), "
                    "live or from a log, as a driver would.")
    parser.add_argument("device", metavar="NAME", help="the sensor, one of those that `srt3d devices` lists")
    parser.add_argument("log", nargs="?", metavar="FILE", help="a log of it, played once")
    parser.add_argument("--connect", metavar="ADDRESS", help="its publisher instead of a log, such as tcp://HOST:5558")
    parser.add_argument("--rate-hz", type=float, metavar="HZ", help="frames a second of a log (10)")
    parser.add_argument("--frame-id", metavar="FRAME", help="tf frame of the histograms (the device's name)")
    common.add_ros_options(parser)
    parser.set_defaults(run=lambda args: node.start_with_options("device", args, PARAMETERS))
