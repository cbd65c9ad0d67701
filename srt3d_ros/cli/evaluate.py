"""`srt3d evaluate`: every method on simulated scenes or photon files, compared with the truth."""

import argparse
from pathlib import Path

from srt3d_ros.cli.common import comma_list
from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.errors import require

_names = comma_list(str, "names with commas between")
_integers = comma_list(int, "integers with commas between")
_numbers = comma_list(float, "numbers with commas between")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "evaluate", help="compare the methods on simulated scenes or on photon files",
        description="Reconstruct simulated scenes (or the photon files given) with every method and compare the "
                    "clouds with the truth: a table, DIR/results.csv, figures and a README.md in DIR. The same "
                    "command goes on where an interrupted one stopped. docs/evaluation.md explains the figures.")
    parser.add_argument("files", nargs="*", metavar="FILE", help="photon files; none: the simulated scenes")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
    parser.add_argument("--methods", type=_names, metavar="A,B,…", help="which methods (all)")
    parser.add_argument("--sketch-size", type=_integers, metavar="M,…",
                        help="complex numbers kept of a pixel (simulated: 5,10,20; files: 10)")
    parser.add_argument("--tolerance", metavar="BINS|MMmm[,NAME=…]",
                        help="how near a true detection is, others for some sources: 10,two_layer=40 (simulated heads: "
                             "40mm, net: 3, files: 10)")
    parser.add_argument("--surfaces", type=int, metavar="K",
                        help="most surfaces in a pixel (the net: 2; a file: as many as it has references)")
    parser.add_argument("--false-alarm-rate", type=float, metavar="P",
                        help="of the methods that have one, as for `srt3d reconstruct`: pooled, smle, xcorr")
    parser.add_argument("--background", choices=BACKGROUNDS,
                        help="how it spreads over the bins, as for `srt3d reconstruct`: pooled")
    parser.add_argument("--quick", action="store_true", help="a first look: few settings, small frames")
    parser.add_argument("--fresh", action="store_true", help="forget the results that DIR has")
    simulated = parser.add_argument_group("simulated scenes")
    simulated.add_argument("--scene", type=_names, metavar="bust|net|lattice|house|FILE.npz[,…]",
                           help="which (bust,net); a file has depth_m, reflectivity, valid")
    simulated.add_argument("--sbr", type=_numbers, metavar="R,…", help="signal-to-background ratios (10,1,0.1)")
    simulated.add_argument("--ppp", type=_numbers, metavar="N,…",
                           help="mean photons per pixel (1,3,10,30,100,300,1000)")
    simulated.add_argument("--repeats", type=int, default=1, metavar="N", help="draws of each setting, averaged (1)")
    simulated.add_argument("--upsampling", type=int, default=1, metavar="U",
                           help="clouds and truth on U × U finer pixels in the place of each, at most 4; methods "
                                "without upsampling repeat their points (1)")
    simulated.add_argument("--max-photons", type=float, default=6e7, metavar="N",
                           help="leave out settings of more photons, for memory's sake (6e7)")
    files = parser.add_argument_group("photon files")
    files.add_argument("--align", type=_integers, default=(), metavar="S,…",
                       help="references, numbered from 1, to shift by their median offset from the cloud: those that "
                            "were measured apart")
    files.add_argument("--seen", type=comma_list(float, "two numbers: photons, bins", count=2), default=(8, 60),
                       metavar="PHOTONS,BINS",
                       help="count an aligned reference only where so many photons lie so near (8,60)")
    files.add_argument("--held-out-photons", type=float, metavar="SHARE",
                       help="reconstruct the other photons, and judge the clouds by how well they predict these (0.4 "
                            "for a file without a reference, else 0)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.evaluation.command import evaluate
    require(args.repeats >= 1, "--repeats", args.repeats, "1 or more")
    return evaluate(args)
