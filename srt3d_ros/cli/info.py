"""`srt3d info`: print the content of photon files in figures, or draw one."""

import argparse
import sys
from pathlib import Path

from srt3d_ros.cli import common
from srt3d_ros.errors import BAD_INPUT, InvalidInput, require

INFO_LINES = """\
{rows} × {cols} pixels, T = {num_bins} bins of {bin_ps:.4g} ps: ranges from {nearest:.4g} to {farthest:.4g} m
{photons:,} photons, {photons_per_pixel:.4g} a pixel, at most {most_photons_in_a_pixel:,}; {empty_pixels:,} pixels empty
SBR {sbr_words}; IRF {irf_width_bins:.3g} bins wide ({irf_ps:.3g} ps, full width at half maximum)
suggested: gate {gate_words}, frequencies {frequency_words}: a sketch of {sketch_bytes:,} bytes"""


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "info",
        description="Print size, photons per pixel, SBR, bins, range, IRF width and notes of photon files, and a gate "
                    "and frequencies that suit each.")
    common.add_photon_file(parser, nargs="+")
    common.add_gate(parser)
    parser.add_argument("-o", "--output", metavar="INFO.png", type=Path,
                        help="also draw the histogram of the photons, the photons of each pixel, and the IRF")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.files.new_files import check_output

    if args.output is not None:
        require(len(args.input) == 1, "output", problem="--output draws one file: give one INPUT.")
        check_output(args.output, suffix=".png")
    if len(args.input) == 1:
        _print(args, *args.input)
        return 0
    code = 0
    for path in args.input:
        if not args.json:
            print(f"\n{path}" if path is not args.input[0] else path, flush=True)
        try:
            _print(args, path)
        except (InvalidInput, ModuleNotFoundError) as error:
            code = BAD_INPUT
            said = common.missing_package(error, "info") if isinstance(error, ModuleNotFoundError) else error
            print(f"srt3d: error: {said}", file=sys.stderr, flush=True)
    return code


def _print(args: argparse.Namespace, path: str) -> None:
    """Print the figures of one file, or raise InvalidInput."""
    from srt3d_ros.core.sketching.gate import in_ranges
    from srt3d_ros.datasets.description import describe

    photons = common.read_photons(args, path, guess_irf=True)
    found = describe(photons)
    facts, gate = {"input": path} | found.facts, found.gate
    if args.output is not None:
        from srt3d_ros.pictures.figures import draw_histogram

        draw_histogram(args.output, found.histogram, found.counts, photons.sensor, gate, Path(path).name)
        facts["output"] = str(args.output)
    if facts["sbr"] is None:
        sbr = "infinite"
    else:
        sbr = f"{facts['sbr']:.3g}" if facts["sbr"] else "too low to measure"
    words = {"bin_ps": facts["bin_width_s"] * 1e12, "irf_ps": facts["irf_width_s"] * 1e12, "sbr_words": sbr,
             "nearest": facts["range_m"][0], "farthest": facts["range_m"][1], "gate_words": in_ranges(gate),
             "frequency_words": ",".join(map(str, facts["frequencies"]))}
    if not args.json:
        common.print_notes(facts["notes"])
    common.print_facts(args, facts, INFO_LINES.format(**facts, **words))
