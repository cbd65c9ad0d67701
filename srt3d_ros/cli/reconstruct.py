"""`srt3d reconstruct`: reconstruct a photon file or a frame of a bag, without ROS, and save the point cloud."""

import argparse
from dataclasses import replace

from srt3d_ros.cli import common
from srt3d_ros.core.keys import keys
from srt3d_ros.core.methods import METHODS, MethodOptions
from srt3d_ros.core.sketching import design
from srt3d_ros.core.sketching.gate import AUTO, OFF
from srt3d_ros.errors import require

NPZ = "npz"
OPTIONS = design.OPTIONS | keys(MethodOptions) | {
    "frequencies": replace(design.OPTIONS["frequencies"], default="those of the method's paper; pooled: auto")}


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "reconstruct",
        description="Sketch the photons of a file, reconstruct them and save the cloud. Some published .mat files lack "
                    "bin width, IRF or gate: give them as options.",
        epilog="Methods. " + " ".join(f"{method.name}: {method.about}." for method in METHODS.values())
               + " Details: docs/algorithm.md.")
    parser.add_argument("-o", "--output", "--out", metavar="OUT", required=True,
                        help="cloud file: .npz (everything), .ply, .pcd, .csv, .tif (depths), .html (turns in "
                             "a browser); or a picture: .png, .jpg; with --frames, a folder")
    common.add_options(parser, OPTIONS)
    parser.set_defaults(gate=OFF)
    many = parser.add_argument_group("many frames")
    many.add_argument("--frames", metavar="all|FIRST-LAST",
                      help="reconstruct each of these frames of a bag or log into a file of its own in the folder OUT")
    many.add_argument("--format", default=NPZ, metavar="SUFFIX", help="suffix of these files (default: npz)")
    common.add_json(parser)
    common.add_photon_file(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros import api
    from srt3d_ros.cli import frames
    from srt3d_ros.datasets import cloud_files
    from srt3d_ros.files.new_files import check_not_input

    options = common.given(args, OPTIONS)
    if args.gate != AUTO:
        options["gate"] = OFF           # `common.overrides` has it
    if args.frames is not None:
        return frames.run(args, options)
    require(args.format == NPZ, "--format", problem="--format needs --frames.")
    check_not_input(args.output, args.input, args.irf, args.sensor_file)
    cloud_files.check(args.output)
    seen = api.read(args.input, args.frame, photons_topic=args.photons_topic, **common.overrides(args))
    cloud = api.reconstruct(seen, **options)
    cloud.save(args.output)
    sensor = cloud.sensor
    facts = {"method": cloud.method, "surfaces": cloud.surfaces, "device": cloud.device, "rows": sensor.rows,
             "cols": sensor.cols, "num_bins": sensor.num_bins, "photons": cloud.photons,
             "sketch_size": len(cloud.frequencies) or None, "frequencies": cloud.frequencies, "points": len(cloud),
             "sketch_ms": cloud.sketch_ms, "reconstruct_ms": cloud.reconstruct_ms, "output": str(args.output)}
    common.print_notes(cloud.notes)     # only now, so that an error is a single line
    sketched = ""
    if facts["frequencies"]:
        sketched = " → sketch of {sketch_size}"
    if facts["sketch_ms"] is not None:
        sketched += " in {sketch_ms:.1f} ms"
    words = ("{photons:,} photons of {rows} × {cols} pixels, T = {num_bins} bins" + sketched
             + " → {points:,} points in {reconstruct_ms:.1f} ms by {method} on {device}\n{output}")
    common.print_facts(args, facts, words.format(**facts))
    return 0
