"""`srt3d convert`: any photon file to the npz photon file, which has everything in one."""

import argparse
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "convert", help="write the photons of any readable file as an npz photon file",
        description="Write the photons and sensor of a file, with what the options and INPUT.json say, as one npz "
                    "photon file (docs/photon-file.md).")
    common.add_photon_file(parser)
    parser.add_argument("output", metavar="OUT.npz", help="photon file to write")
    common.add_gate(parser)
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.datasets import photon_file, read
    from srt3d_ros.new_files import atomic_write, check_not_input, check_place

    output = Path(args.output)
    require(output.suffix.lower() == ".npz", "output", output.name, "a name that ends in .npz")
    check_place(output)
    check_not_input(output, args.input, args.irf)
    photons = read(args.input, args.frame, args.photons_topic, **common.overrides(args))
    with atomic_write(output) as part:
        photon_file.save(part, photons.sensor, photons.frame, photons.reference_depth_bins)
    sensor = photons.sensor
    common.print_notes(photons.notes)
    common.print_facts(args, {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                              "photons": photons.frame.photons, "bytes": output.stat().st_size, "output": str(output)},
                       "{photons:,} photons of {rows} × {cols} pixels, T = {num_bins} bins: {bytes:,} bytes\n{output}")
    return 0
