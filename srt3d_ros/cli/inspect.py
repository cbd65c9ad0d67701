"""`srt3d inspect`: draw one pixel of a photon file, with what its points make expected."""

import argparse
import re
from pathlib import Path

import numpy as np

from srt3d_ros.cli import common, reconstruct
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.errors import require

OPTIONS = {name: key for name, key in reconstruct.OPTIONS.items() if name != "gate"}


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "inspect",
        description="Reconstruct a photon file and draw one pixel: its histogram, the fitted impulse responses and "
                    "background, what they leave (in σ), and its points. The pixels around a pixel share in its "
                    "points: a residual shows where they, or the IRF, do not fit.")
    parser.add_argument("--pixel", metavar="R,C", required=True, help="row and column, from 0")
    parser.add_argument("-o", "--output", metavar="PIXEL.png", type=Path, required=True, help="the picture")
    common.add_options(parser, OPTIONS)
    common.add_gate(parser)
    common.add_json(parser)
    common.add_photon_file(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros import api
    from srt3d_ros.files.new_files import check_not_input, check_output
    from srt3d_ros.pictures.pixel import draw_pixel

    check_not_input(check_output(args.output, suffix=".png"), args.input, args.irf, args.sensor_file)
    reading = common.read_photons(args, args.input)
    sensor, frame = reading.sensor, reading.frame
    pixel = re.fullmatch(r"(\d{1,9}),(\d{1,9})", args.pixel)
    require(pixel, "pixel", args.pixel, "row and column from 0, such as 12,40")
    row, col = map(int, pixel.groups())
    require(row < sensor.rows and col < sensor.cols, "pixel", args.pixel,
            f"row below {sensor.rows} and column below {sensor.cols}")
    cloud = api.reconstruct(api.noun_of(reading), **common.given(args, OPTIONS))
    if isinstance(frame, PhotonHistograms):
        counts = frame.on_axis(sensor)[row, col].astype(np.float64)
    else:
        toa = frame.toa[frame.pixel == row * sensor.cols + col]
        counts = np.bincount(sensor.toa_bins(toa), minlength=sensor.num_bins).astype(np.float64)
    points, labels = [], []
    for k in np.flatnonzero((cloud.row == row) & (cloud.col == col)):
        range_m, photons = float(sensor.range_m(cloud.depth_bins[k])), float(cloud.intensity[k])
        std_m = float(cloud.depth_std_bins[k]) * sensor.bin_width_m
        known = bool(np.isfinite(std_m))        # not of all methods
        points.append({"range_m": range_m, "depth_std_m": std_m if known else None, "intensity": photons})
        labels.append(f"{range_m:.4g} m" + f" ± {1e3 * std_m:.3g} mm" * known + f", {photons:.3g} signal photons")
    facts = {"pixel": [row, col], "photons": round(counts.sum()), "background": float(cloud.background[row, col]),
             "points": points, "output": str(args.output)}
    words = f"pixel {row},{col}: {facts['photons']:,} photons, {facts['background']:.3g} expected of background"
    draw_pixel(args.output, counts, cloud, row, col, f"{Path(args.input).name}, {words}", labels)
    common.print_notes(cloud.notes)
    common.print_facts(args, facts, "\n".join([words, *(labels or ["no point"]), str(args.output)]))
    return 0
