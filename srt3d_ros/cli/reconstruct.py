"""`srt3d reconstruct`: a photon file, a frame of a bag, or all its frames, to point cloud files, without ROS."""

import argparse
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.core.method.background import BACKGROUNDS
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS
from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.core.sketching.gate import AUTO, OFF
from srt3d_ros.errors import require

METHOD_OPTIONS = ("method", "sketch_size", "frequencies", "surfaces", "device", "false_alarm_rate", "background")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "reconstruct", help="reconstruct a photon file or frames of a bag and save the point clouds",
        description="Sketch the photons of a file, reconstruct them and save the cloud. A published .mat file may lack "
                    "bin width, IRF or gate: give them as options, or in a sidecar INPUT.json.",
        epilog="Methods. " + " ".join(f"{method.name}: {method.about}." for method in METHODS.values())
               + " docs/algorithm.md says more.")
    parser.add_argument("-o", "--output", "--out", metavar="OUT", required=True,
                        help="cloud file: .npz (everything), .ply, .pcd; or a picture of it: "
                             ".png, .jpg; with --frames a folder")
    parser.add_argument("--sketch-size", type=int, metavar="M",
                        help=f"complex numbers kept of a pixel ({DEFAULT_SKETCH_SIZE})")
    parser.add_argument("--frequencies", metavar="auto|consecutive|k1,k2,…",
                        help="which they are: least expected error for the IRF (auto), 1 … M (consecutive), "
                             "or a list; unless given what the method is published with, else auto")
    parser.add_argument("--surfaces", type=int, default=1, metavar="K", help="most surfaces in a pixel (1)")
    parser.add_argument("--method", default=DEFAULT_METHOD, metavar="NAME",
                        help=f"how to reconstruct: {', '.join(METHODS)} ({DEFAULT_METHOD})")
    common.add_device(parser)
    parser.add_argument("--false-alarm-rate", type=float, metavar="P",
                        help=f"probability that a pixel with background alone shows a point (pooled: "
                             f"{DEFAULT_FALSE_ALARM_RATE:g})")
    parser.add_argument("--background", choices=BACKGROUNDS,
                        help="how it spreads over the bins (pooled): as the frame itself shows, if that is "
                             "significantly uneven (auto, the default); as the file says (sensor); evenly (flat)")
    parser.add_argument("--gate", default=OFF, metavar="FIRST-LAST|auto|off",
                        help="keep the photons of bins FIRST to LAST only, or of those in which the histogram of all "
                             "photons shows a scene (auto); T becomes their number (off)")
    common.add_json(parser)
    common.add_photon_file(parser)
    many = parser.add_argument_group("many frames of a bag or log", "OUT gets a file for each, that of --frame N. The "
                                     "same command goes on where an interrupted one stopped.")
    many.add_argument("--frames", choices=("all",), help="every frame by itself")
    many.add_argument("--format", metavar="SUFFIX", help="of the files: npz, ply, pcd, … as for OUT (npz)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.new_files import check_not_input

    check_not_input(args.output, args.input, args.irf)
    options = common.given(args, METHOD_OPTIONS) | {"gate": args.gate if args.gate == AUTO else OFF}
    if args.frames is None:
        require(args.format is None, "format", args.format, "nothing without --frames")
        return _one(args, options)
    require(args.frame == 0, "frame", args.frame, "nothing beside --frames")
    return _many(args, options)


def _one(args: argparse.Namespace, options: dict) -> int:
    from srt3d_ros import api
    from srt3d_ros.recording import cloud_files

    cloud_files.check(args.output)
    seen = api.read(args.input, args.frame, photons_topic=args.photons_topic, **common.overrides(args))
    cloud = api.reconstruct(seen, **options)
    cloud.save(args.output)
    facts = cloud.facts | {"output": str(args.output)}
    common.print_notes(cloud.notes)     # only now: a mistake is one line
    sketched = (" → sketch of {sketch_size}" * bool(facts["frequencies"])
                + " in {sketch_ms:.1f} ms" * (facts["sketch_ms"] is not None))
    common.print_facts(args, facts, "{photons:,} photons of {rows} × {cols} pixels, T = {num_bins} bins" + sketched
                        + " → {points:,} points in {reconstruct_ms:.1f} ms by {method} on {device}\n{output}")
    return 0


def _many(args: argparse.Namespace, options: dict) -> int:
    from srt3d_ros.batch import reconstruct_frames

    found = reconstruct_frames(Path(args.input), args.photons_topic, common.overrides(args), options,
                               Path(args.output), args.format or "npz")
    common.print_notes(found["notes"])
    if found["failed"]:
        common.print_notes([f"{found['failed']} of {found['frames']} frames failed; the same command tries them again"])
    common.print_facts(args, found | {"output": str(args.output)},
                       "{done} of {frames} frames reconstructed, {points:,} points; {earlier} were there, {failed} "
                       "failed\n{output}")
    return 1 if found["failed"] else 0
