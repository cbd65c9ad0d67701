"""`srt3d info`: print the content of photon files in figures, or draw one."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from srt3d_ros.cli import common
from srt3d_ros.errors import BAD_INPUT, InvalidInput, require

if TYPE_CHECKING:
    from srt3d_ros.core.sketching.gate import Gate
    from srt3d_ros.core.sketching.plausibility import Light
    from srt3d_ros.datasets.reading import Reading

WORD_BYTES = 4              # of each real number and of the count in a sketch
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
    from srt3d_ros.core.sketching.plausibility import light_of

    photons = common.read_photons(args, path, guess_irf=True)
    light = light_of(photons.frame, photons.sensor)
    facts, gate = _facts(photons, light)
    facts = {"input": path} | facts
    if args.output is not None:
        from srt3d_ros.pictures.figures import draw_histogram

        draw_histogram(args.output, light.of_bins, light.of_pixels, photons.sensor, gate, Path(path).name)
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


def _facts(photons: "Reading", light: "Light") -> "tuple[dict, Gate | None]":
    """Figures of photons by name, None if unknown or infinite; and the gate that suits them."""
    from srt3d_ros.core.sensor.pulse import full_width_at_half_maximum
    from srt3d_ros.core.sketching.design import design_sketch, histogram, signal_to_background
    from srt3d_ros.core.sketching.gate import AUTO

    frame, sensor = photons.frame, photons.sensor
    gate, frequencies = design_sketch(sensor, AUTO, frame=frame)
    sbr = signal_to_background(histogram(frame, sensor), sensor)
    used, irf_width_bins = light.of_pixels[sensor.used], full_width_at_half_maximum(sensor)
    return {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins, "bin_width_s": sensor.bin_width_s,
            "range_m": sensor.range_m([0, sensor.num_bins]).tolist(), "photons": round(light.of_pixels.sum()),
            "photons_per_pixel": float(used.mean()) if used.size else 0.0,
            "most_photons_in_a_pixel": round(used.max(initial=0)),
            "empty_pixels": int((used <= 0).sum()), "sbr": sbr if math.isfinite(sbr) else None,
            "irf_width_bins": irf_width_bins, "irf_width_s": irf_width_bins * sensor.bin_width_s,
            "gate": None if gate is None else [gate.first, gate.last], "frequencies": list(frequencies),
            "sketch_bytes": sensor.pixels * WORD_BYTES * (2 * len(frequencies) + 1), "notes": [*photons.notes]}, gate
