"""`srt3d reconstruct`: a photon file, or a frame of a bag, to a point cloud file, without ROS."""

import argparse
import time
from dataclasses import replace

from srt3d_ros.cli import common
from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import SURFACE_ORDERS
from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.core.gate import AUTO, OFF, parse
from srt3d_ros.core.methods import DEFAULT_METHOD, METHODS, Method, find
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.errors import require

METHOD_OPTIONS = ("surfaces", "device", "false_alarm_rate", "background", "weighting", "upsampling")
OVERRIDES = ("num_bins", "bin_width_s", "irf", "irf_ref", "fov_deg")


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "reconstruct", help="reconstruct a photon file or a frame of a bag and save the point cloud",
        description="Sketch the photons of a file, reconstruct them and save the cloud. A published .mat file may lack "
                    "bin width, IRF or gate: give them as options, or in a sidecar INPUT.json.",
        epilog="Methods. " + " ".join(f"{method.name}: {method.about}." for method in METHODS.values())
               + " docs/algorithm.md says more.")
    parser.add_argument("input", metavar="INPUT", help="photon file: .npz (docs/photon-file.md), or .mat as published; "
                                                       "or a bag (docs/bags.md)")
    parser.add_argument("--frame", type=int, default=0, metavar="N",
                        help="message of a bag's photons, or sketches if it has no photons, from 0 (0)")
    parser.add_argument("--photons-topic", default="", metavar="TOPIC",
                        help="where a bag's photons or sketches are, if several of its topics have some")
    parser.add_argument("-o", "--output", metavar="OUT", required=True,
                        help="cloud file: .npz (everything), .ply, .pcd, or .rrd (opens in rerun)")
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
    sensor = parser.add_argument_group("what the file does not say")
    sensor.add_argument("--num-bins", type=int, metavar="T", help="bins of a laser period")
    sensor.add_argument("--bin-width-s", type=float, metavar="S", help="width of a bin, seconds")
    sensor.add_argument("--irf", metavar="FILE", help="impulse response: .npz, .npy, .csv or .txt")
    sensor.add_argument("--irf-ref", type=int, metavar="INDEX", help="entry of the IRF that marks the depth (its peak)")
    sensor.add_argument("--fov-deg", type=float, metavar="DEG", help="field of view across the larger side, degrees")
    sensor.add_argument("--dark", metavar="FILE",
                        help="photon file recorded without the laser's echo: how the background spreads over the bins")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.datasets.bag import is_bag
    from srt3d_ros.datasets.bag_photons import read_sketch
    from srt3d_ros.recording import cloud_files

    method = find(args.method)
    cloud_files.check(args.output)
    found = read_sketch(args.input, args.frame, args.photons_topic) if is_bag(args.input) else None
    if found is None:
        sensor, frequencies, seen, photons, sketch_ms, notes = _from_photons(args, method)
    else:
        sensor, seen = found
        frequencies, photons, sketch_ms, notes = seen.frequencies, int(seen.photons.sum()), None, ()
        for name in ("sketch_size", "frequencies", "gate", "dark", *OVERRIDES):
            given = getattr(args, name)
            require(given in (None, OFF), name, given, "nothing: the bag has sketches, made without it")
        require(method.needs == "sketch", "method", method.name, "one of sketches, which the bag has")
    reconstructor = method.build(sensor, frequencies, **common.given(args, METHOD_OPTIONS))
    reconstructor.warm_up()
    cloud, reconstruct_ms = _timed(reconstructor, seen)
    cloud = cloud.ordered(args.surface_order)
    cloud_files.save(cloud, args.output, frequencies=frequencies, sensor=reconstructor.sensor)
    facts = {"method": args.method, "device": reconstructor.device, "rows": sensor.rows, "cols": sensor.cols,
             "num_bins": sensor.num_bins, "photons": photons, "sketch_size": len(frequencies) or None,
             "frequencies": list(frequencies), "surfaces": args.surfaces,
             "upsampling": args.upsampling or 1, "points": len(cloud), "sketch_ms": sketch_ms,
             "reconstruct_ms": reconstruct_ms, "output": str(args.output)}
    common.print_notes(notes)       # only now: a mistake is one line
    sketched = " → sketch of {sketch_size}" * bool(frequencies) + " in {sketch_ms:.1f} ms" * (sketch_ms is not None)
    common.print_facts(args, facts, "{photons:,} photons of {rows} × {cols} pixels, T = {num_bins} bins" + sketched
                        + " → {points:,} points in {reconstruct_ms:.1f} ms by {method} on {device}\n{output}")
    return 0


def _from_photons(args: argparse.Namespace, method: Method) -> tuple:
    """Sensor, frequencies, what the method takes, number of photons, time to sketch them, and notes."""
    from srt3d_ros.core.sketch_design import design_for
    from srt3d_ros.core.sketching import sketch_photons
    from srt3d_ros.datasets import open_photons

    frequencies = ()
    overrides = common.given(args, OVERRIDES) | _fixed_gate(args.gate)
    photons = open_photons(args.input, args.frame, args.photons_topic, **overrides)
    sensor, frame = photons.sensor, photons.frame
    if args.dark is not None:
        require("background" in method.options, "dark", args.dark, f"nothing: {method.name} has no use for it")
        require(args.background != "flat", "background", args.background, "auto or sensor, with a dark frame")
        known = {"irf": sensor.irf, "irf_ref": sensor.irf_ref, "bin_width_s": sensor.bin_width_s}
        sensor = _with_dark_frame(sensor, open_photons(args.dark, **(known | overrides)))
    spec = args.frequencies or method.frequencies
    if args.gate == AUTO:
        found = design_for(frame, sensor, AUTO, *((spec, args.sketch_size) if method.needs == "sketch" else ())).gate
        if found is not None:
            photons = replace(photons, sensor=sensor).gated(found)
            sensor, frame = photons.sensor, photons.frame
    if method.needs == "sketch":
        frequencies = design_for(frame, sensor, frequencies=spec, sketch_size=args.sketch_size).frequencies
    for name in ("sketch_size", "frequencies"):
        given = getattr(args, name)
        require(frequencies or given is None, name, given, f"nothing: {method.name} makes no sketch")
    seen, sketch_ms = (frame, None) if method.needs != "sketch" else _timed(sketch_photons, frame, sensor, frequencies)
    return sensor, frequencies, seen, frame.photons, sketch_ms, photons.notes


def _fixed_gate(spec: str) -> dict[str, tuple[int, int]]:
    """The option `gate` of open_photons, first bin and number of bins, if the gate is fixed."""
    bins = parse(spec)
    if bins in (OFF, AUTO):
        return {}
    first, last = bins
    require(0 <= first < last, "gate", spec, "a first bin of 0 or more and below the last")
    return {"gate": (first, last - first + 1)}


def _with_dark_frame(sensor, dark):
    """The sensor with the background of a dark frame that it recorded."""
    from srt3d_ros.core.background import dark_shape

    for name in ("rows", "cols", "num_bins"):
        found, wanted = getattr(dark.sensor, name), getattr(sensor, name)
        require(found == wanted, f"dark frame {name}", found, f"{wanted}, as in the input")
    return sensor.replace(background_shape=dark_shape(dark.frame, sensor))


def _timed(function, *arguments):
    """What function(*arguments) returns, and the milliseconds it took."""
    started = time.perf_counter()
    result = function(*arguments)
    return result, round((time.perf_counter() - started) * 1e3, 3)
