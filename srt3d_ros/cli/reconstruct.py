"""`srt3d reconstruct`: a photon file, or a frame of a bag, to a point cloud file, without ROS."""

import argparse
from typing import TYPE_CHECKING

from srt3d_ros.cli import common
from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import SURFACE_ORDERS
from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.core.gate import AUTO, OFF
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS, find
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.errors import require

if TYPE_CHECKING:
    from srt3d_ros.results import Cloud, Sketch

METHOD_OPTIONS = ("method", "sketch_size", "frequencies", "surfaces", "device", "false_alarm_rate", "background",
                  "weighting", "upsampling")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "reconstruct", help="reconstruct a photon file or a frame of a bag and save the point cloud",
        description="Sketch the photons of a file, reconstruct them and save the cloud. A published .mat file may lack "
                    "bin width, IRF or gate: give them as options, or in a sidecar INPUT.json.",
        epilog="Methods. " + " ".join(f"{method.name}: {method.about}." for method in METHODS.values())
               + " docs/algorithm.md says more.")
    parser.add_argument("-o", "--output", metavar="OUT", required=True,
                        help="cloud file: .npz (everything), .ply, .pcd, .rrd (opens in rerun); or a picture of it: "
                             ".png, .jpg")
    parser.add_argument("--sketch-size", type=int, metavar="M",
                        help=f"complex numbers kept of a pixel ({DEFAULT_SKETCH_SIZE})")
    parser.add_argument("--frequencies", metavar="auto|spread|consecutive|k1,k2,…",
                        help="which they are: least expected error for these photons (auto), spread over what the IRF "
                             "passes, 1 … M, or a list; unless given what the method is published with, else auto")
    parser.add_argument("--surfaces", type=int, default=1, metavar="K", help="most surfaces in a pixel (1)")
    parser.add_argument("--surface-order", choices=SURFACE_ORDERS, default="strongest",
                        help="which of a pixel's surfaces comes first in the file (strongest)")
    parser.add_argument("--method", default=DEFAULT_METHOD, metavar="NAME",
                        help=f"how to reconstruct: {', '.join(METHODS)} ({DEFAULT_METHOD})")
    common.add_device(parser)
    parser.add_argument("--false-alarm-rate", type=float, metavar="P",
                        help="probability that a pixel with background alone shows a point (pooled: 1e-4; smle and "
                             "xcorr: show a point wherever there are photons)")
    parser.add_argument("--weighting", choices=WEIGHTINGS,
                        help="W of the data term (smle: precision; srt3d: identity; others have none)")
    parser.add_argument("--background", choices=BACKGROUNDS,
                        help="how it spreads over the bins (pooled): as the frame itself shows, if that is "
                             "significantly uneven (auto, the default); as the file says (sensor); evenly (flat)")
    parser.add_argument("--upsampling", type=int, metavar="U",
                        help="finer pixels of the cloud along the side of each pixel, at most 4 (pooled: 1)")
    parser.add_argument("--gate", default=OFF, metavar="FIRST:LAST|auto|off",
                        help="keep the photons of bins FIRST to LAST only, or of those in which the histogram of all "
                             "photons shows a scene (auto); T becomes their number (off)")
    common.add_json(parser)
    common.add_photon_file(parser)
    parser.add_argument("--dark", metavar="FILE",
                        help="photon file recorded without the laser's echo: how the background spreads over the bins")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros import api
    from srt3d_ros.new_files import check_not_input
    from srt3d_ros.recording import cloud_files

    cloud_files.check(args.output)
    check_not_input(args.output, args.input, args.dark, args.irf)
    sketch = _sketch_of_bag(args)
    cloud = (_of_photons(args) if sketch is None else api.reconstruct(sketch, **common.given(args, METHOD_OPTIONS)))
    cloud = cloud.ordered(args.surface_order)
    cloud.save(args.output)
    facts = cloud.facts | {"output": str(args.output)}
    common.print_notes(cloud.notes)     # only now: a mistake is one line
    sketched = (" → sketch of {sketch_size}" * bool(facts["frequencies"])
                + " in {sketch_ms:.1f} ms" * (facts["sketch_ms"] is not None))
    common.print_facts(args, facts, "{photons:,} photons of {rows} × {cols} pixels, T = {num_bins} bins" + sketched
                        + " → {points:,} points in {reconstruct_ms:.1f} ms by {method} on {device}\n{output}")
    return 0


def _sketch_of_bag(args: argparse.Namespace) -> "Sketch | None":
    """The sketch that the input has instead of photons; InvalidInput for options that only photons can follow."""
    from srt3d_ros.datasets.bag import is_bag
    from srt3d_ros.datasets.bag_photons import read_sketch
    from srt3d_ros.results import Sketch

    found = read_sketch(args.input, args.frame, args.photons_topic) if is_bag(args.input) else None
    if found is None:
        return None
    for name in ("sketch_size", "frequencies", "gate", "dark", *common.SENSOR_OVERRIDES):
        given = getattr(args, name)
        require(given in (None, OFF), name, given, "nothing: the bag has sketches, made without it")
    sensor, sketch = found
    return Sketch(**vars(sketch), sensor=sensor)


def _of_photons(args: argparse.Namespace) -> "Cloud":
    from srt3d_ros import api

    method, overrides = find(args.method), common.overrides(args)
    photons = api.open(args.input, args.frame, args.photons_topic, **overrides)
    sensor = photons.sensor
    if args.dark is not None:
        require("background" in method.options, "dark", args.dark, f"nothing: {method.name} has no use for it")
        require(args.background != "flat", "background", args.background, "auto or sensor, with a dark frame")
        known = {"irf": sensor.irf, "irf_ref": sensor.irf_ref, "bin_width_s": sensor.bin_width_s}
        sensor = _with_dark_frame(sensor, api.open(args.dark, **(known | overrides)).read_whole())
    return api.reconstruct(photons, sensor=sensor, gate=args.gate if args.gate == AUTO else OFF,
                           **common.given(args, METHOD_OPTIONS))


def _with_dark_frame(sensor, dark):
    """The sensor with the background of a dark frame that it recorded."""
    from srt3d_ros.core.background import dark_shape

    for name in ("rows", "cols", "num_bins"):
        found, wanted = getattr(dark.sensor, name), getattr(sensor, name)
        require(found == wanted, f"dark frame {name}", found, f"{wanted}, as in the input")
    return sensor.replace(background_shape=dark_shape(dark.frame, sensor))
