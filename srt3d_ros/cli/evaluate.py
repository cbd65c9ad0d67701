"""`srt3d evaluate`: every method on simulated scenes or photon files, compared with the truth."""

import argparse
from pathlib import Path

from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.evaluation.cases import SCENES


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "evaluate", help="compare the methods on simulated scenes or on photon files",
        description="Reconstruct simulated scenes (or the photon files given) with every method and compare the "
                    "clouds with the truth: a table, DIR/results.csv, and pictures in DIR. "
                    "docs/evaluation.md explains the figures.")
    parser.add_argument("files", nargs="*", metavar="FILE", help="photon files; none: the simulated scenes")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
    parser.add_argument("--methods", nargs="+", default=METHODS, metavar="METHOD",
                        help=f"some of {', '.join(METHODS)} (all)")
    parser.add_argument("--sketch-size", nargs="+", type=int, default=[DEFAULT_SKETCH_SIZE], metavar="M",
                        help=f"complex numbers kept of a pixel ({DEFAULT_SKETCH_SIZE})")
    parser.add_argument("--tolerance", metavar="BINS|MMmm",
                        help="how near a true detection is (bust: 40mm, net: 3, files: 10)")
    parser.add_argument("--surfaces", type=int, metavar="K",
                        help="most surfaces in a pixel (the net: 2; a file: as many as it has references)")
    simulated = parser.add_argument_group("simulated scenes")
    simulated.add_argument("--scene", nargs="+", choices=tuple(SCENES), metavar="SCENE",
                           help=f"some of {', '.join(SCENES)} (all)")
    simulated.add_argument("--sbr", nargs="+", type=float, default=[10.0, 1.0, 0.1], metavar="R",
                           help="signal-to-background ratios (10 1 0.1)")
    simulated.add_argument("--ppp", nargs="+", type=float, default=[1.0, 10.0, 100.0], metavar="N",
                           help="mean photons per pixel (1 10 100)")
    simulated.add_argument("--repeats", type=int, default=1, metavar="N", help="draws of each setting, averaged (1)")
    files = parser.add_argument_group("photon files")
    files.add_argument("--align", nargs="+", type=int, default=[], metavar="S",
                       help="references, numbered from 1, to shift by their median offset from the cloud: those that "
                            "were measured apart")
    files.add_argument("--held-out-photons", type=float, metavar="SHARE",
                       help="reconstruct the other photons, and judge the clouds by how well they predict these (0.4 "
                            "for a file without a reference, else 0)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.evaluation.command import evaluate

    return evaluate(args)
