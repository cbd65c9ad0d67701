"""`srt3d benchmark`: the timings of the SRT3D paper, on this machine."""

import argparse
from pathlib import Path

from srt3d_ros.benchmark.plan import PARTS
from srt3d_ros.cli.common import add_device
from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "benchmark", help="time reconstruction, sketching and the ROS 2 nodes; error in equal bytes",
        description="Time this machine, beside the figures of the SRT3D paper: table1, a frame against the size of "
                    "image and sketch; figure1, every method against photons per pixel, as a picture; sketching, "
                    "photons a second; ros, latency and highest frame rate through real nodes. And bytes: the depth "
                    "error of sketches, histograms and photons that take the same bytes, as a picture. Each "
                    "measurement is a line of DIR/<machine>.jsonl.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; all of them unless given")
    parser.add_argument("--bytes", nargs="*", metavar="FILE", help="the part bytes alone, on simulated frames and on "
                        "these photon files with reference depths")
    parser.add_argument("--tolerance", metavar="BINS", help="largest depth error of a true detection in the files of "
                        "--bytes, as of srt3d evaluate: 10, 5mm, or 10,face=40 (10)")
    add_device(parser)
    parser.add_argument("--repeats", type=int, metavar="N", help="timed runs of each, of which median, min and max "
                        "are reported (5)")
    parser.add_argument("--quick", action="store_true",
                        help="a first look: less of everything; to <machine>-quick.jsonl")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results"), metavar="DIR",
                        help="folder of the results (%(default)s)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    for part in args.parts:
        require(part in PARTS, "part", part, f"{', '.join(PARTS)}, or none for all")
    require(args.tolerance is None or args.bytes, "--tolerance", args.tolerance, "with --bytes FILE")
    require(args.repeats is None or args.repeats >= 1, "--repeats", args.repeats, "1 or more")
    require(not args.out.exists() or args.out.is_dir(), "--out", str(args.out), "a folder")
    from srt3d_ros.benchmark.command import benchmark
    return benchmark(args)
