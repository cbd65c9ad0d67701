"""What several sub-commands have in common: options, and how results are printed."""

import argparse
import json
import sys
from collections.abc import Iterable


def given(args: argparse.Namespace, names: Iterable[str]) -> dict[str, object]:
    """The options of these names that were given, by name."""
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


SENSOR_OVERRIDES = ("num_bins", "bin_width_s", "irf", "irf_ref", "fov_deg", "rows", "cols", "cycles", "channel")


def add_photon_file(parser: argparse.ArgumentParser) -> None:
    """INPUT, which frame of it, and options for what it does not say."""
    parser.add_argument("input", metavar="INPUT",
                        help="photon file: .npz, .mat as published, a laboratory's (.ptu, .npy; "
                             "docs/photon-file.md), a log of histograms, a bag (docs/bags.md), or: simulator")
    parser.add_argument("--frame", type=int, default=0, metavar="N", help="message of a bag's photons, from 0 (0)")
    parser.add_argument("--photons-topic", default="", metavar="TOPIC",
                        help="where a bag's photons are, if it has several topics of them")
    sensor = parser.add_argument_group("what the file does not say")
    sensor.add_argument("--num-bins", type=int, metavar="T", help="bins of a laser period")
    sensor.add_argument("--bin-width-s", type=float, metavar="S", help="width of a bin, seconds")
    sensor.add_argument("--irf", metavar="FILE", help="impulse response: .npz, .npy, .csv or .txt")
    sensor.add_argument("--irf-ref", type=int, metavar="INDEX", help="entry of the IRF that marks the depth (its peak)")
    sensor.add_argument("--cycles", type=int, metavar="N", help="laser cycles of the frame, to correct pile-up: of a "
                        "detector that records the first photon of each")
    sensor.add_argument("--fov-deg", type=float, metavar="DEG", help="field of view across the larger side, degrees")
    sensor.add_argument("--rows", type=int, metavar="N", help="of photons in a file that does not say it")
    sensor.add_argument("--cols", type=int, metavar="N", help="the same")
    sensor.add_argument("--channel", type=int, metavar="C",
                        help="whose photons to take, of several detectors or data sets (that with the most)")


def overrides(args: argparse.Namespace) -> dict[str, object]:
    """The options of `datasets.read` that were given; `--gate auto` is none of them."""
    from srt3d_ros.core.sketching.gate import AUTO, OFF, parse

    bins = parse(args.gate)
    found = given(args, SENSOR_OVERRIDES)
    return found if bins in (OFF, AUTO) else found | {"gate": bins}


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one line of JSON instead of words")


def print_notes(notes: Iterable[str]) -> None:
    """Print what the user should know beside the result, on stderr."""
    for note in notes:
        print(f"srt3d: {note}", file=sys.stderr)


def print_facts(args: argparse.Namespace, facts: dict, words: str) -> None:
    """Print the facts as JSON with --json, else in `words`."""
    print(json.dumps(facts) if args.json else words)
