"""Options and output shared by several sub-commands."""

import argparse
import json
import sys
from collections.abc import Iterable


def given(args: argparse.Namespace, names: Iterable[str]) -> dict[str, object]:
    """Those of the options `names` that were given on the command line."""
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


SENSOR_OVERRIDES = ("num_bins", "bin_width_s", "irf", "irf_ref", "fov_deg", "rows", "cols", "cycles", "channel",
                    "axes", "columns")


def add_photon_file(parser: argparse.ArgumentParser) -> None:
    """Add INPUT and the options that choose its frame and describe its sensor."""
    parser.add_argument("input", metavar="INPUT",
                        help="photon file (.npz, .npy, .mat, .h5, .ptu, .sdt, a log of histograms: "
                             "docs/photon-file.md), bag (docs/bags.md), or: simulator")
    parser.add_argument("--frame", type=int, default=0, metavar="N",
                        help="number of the photon message in a bag, from 0 (default: 0)")
    parser.add_argument("--photons-topic", default="", metavar="TOPIC",
                        help="topic of the photons, if a bag has several")
    sensor = parser.add_argument_group("sensor options (they override the file)")
    add_sensor_file(sensor)
    sensor.add_argument("--num-bins", type=int, metavar="T", help="bins per laser period")
    sensor.add_argument("--bin-width-s", type=float, metavar="S", help="width of a bin, seconds")
    sensor.add_argument("--irf", metavar="FILE", help="impulse response: .npz, .npy, .mat, .csv or .txt")
    sensor.add_argument("--irf-ref", type=int, metavar="INDEX",
                        help="entry of the IRF that marks the depth (default: its peak)")
    sensor.add_argument("--cycles", type=int, metavar="N", help="laser cycles of the frame, to correct pile-up in a "
                        "detector that records only the first photon of each cycle")
    sensor.add_argument("--fov-deg", type=float, metavar="DEG", help="field of view across the larger side, degrees")
    sensor.add_argument("--rows", type=int, metavar="N", help="rows of the sensor, if the file does not give them")
    sensor.add_argument("--cols", type=int, metavar="N", help="columns of the sensor, likewise")
    sensor.add_argument("--channel", type=int, metavar="C",
                        help="detector channel or data set (default: the one with most photons; of Photon-HDF5 all)")
    sensor.add_argument("--axes", metavar="A,B,C",
                        help="order of the axes of an array of counts: bins,rows,cols (default: rows,cols,bins)")
    sensor.add_argument("--columns", metavar="ROW,COL,TOA",
                        help="names of the arrays with row, column and ToA of each photon (default: row,col,toa)")


def add_sensor_file(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--sensor-file", metavar="FILE",
                       help="description of the sensor: .json as in config/sensors/, or a photon file; the other "
                            "options override it")


def given_sensor(args: argparse.Namespace) -> dict[str, object]:
    """`sensor` for `datasets.read`, if there is a --sensor-file."""
    from srt3d_ros.datasets import open_sensor

    return {} if args.sensor_file is None else {"sensor": open_sensor(args.sensor_file)}


def overrides(args: argparse.Namespace) -> dict[str, object]:
    """The given options that `datasets.read` takes. A gate of `auto` is left to the reconstruction."""
    from srt3d_ros.core.sketching.gate import AUTO, OFF, parse

    options, bins = given_sensor(args) | given(args, SENSOR_OVERRIDES), parse(args.gate)
    return options if bins in (OFF, AUTO) else options | {"gate": bins}


def add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one line of JSON instead of words")


def print_notes(notes: Iterable[str]) -> None:
    """Print notes on stderr."""
    for note in notes:
        print(f"srt3d: {note}", file=sys.stderr)


def print_facts(args: argparse.Namespace, facts: dict, words: str) -> None:
    """Print `facts` as JSON with --json, otherwise `words`."""
    print(json.dumps(facts) if args.json else words)
