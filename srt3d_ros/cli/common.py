"""Options and output shared by several sub-commands."""

import argparse
import json
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from srt3d_ros.core.keys import Key
    from srt3d_ros.datasets.reading import Reading


# The extra of this package that installs each optional package.
EXTRAS = {"rclpy": "ros", "std_msgs": "ros", "diagnostic_msgs": "ros", "sensor_msgs": "ros", "nav_msgs": "ros",
          "rerun": "record", "pyarrow": "record", "matplotlib": "pictures", "PIL": "pictures",
          "jinja2": "review", "rosbags": "bags", "mcap": "bags", "torch": "gpu", "ptufile": "lab", "sdtfile": "lab",
          "h5py": "lab", "phconvert": "tttr"}
DRAWING = ("demo", "review")        # commands that need all of `review`, which includes `record`
FAILED = 1


def missing_package(error: ModuleNotFoundError, command: str) -> str:
    """How to install a missing package; raises the error if it is none of EXTRAS."""
    extra = EXTRAS.get(error.name or "")
    if extra is None:
        raise error
    ros = "source a ROS 2 installation, or " if extra == "ros" else ""
    extra = "review" if command in DRAWING and extra in ("record", "pictures") else extra
    return f"{error.name} is not installed: {ros}pip install '.[{extra}]' in the clone"


def given(args: argparse.Namespace, names: Iterable[str]) -> dict[str, object]:
    """Those of the options `names` that were given on the command line."""
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


VALUES = {"irf": "FILE", "array": "NAME", "mask": "auto|off", "axes": "A,B,C", "columns": "ROW,COL,TOA",
          "bin_width_s": "S", "fov_deg": "DEG", "method": "NAME", "sketch_size": "M",
          "frequencies": "auto|consecutive|K1,K2,…", "surfaces": "K", "gate": "FIRST-LAST|auto|off",
          "false_alarm_rate": "P"}


def number(text: str) -> int | float:
    """A number as it is written: whether it may have a fraction is for its `Key` to say."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def add_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup, options: dict[str, "Key"]) -> None:
    """An option of the command line for each key."""
    for name, key in options.items():
        unit = f", {key.unit}econds" if key.unit == "s" else ""
        default = "" if key.default is None else f" (default: {key.default})"
        if key.kinds == (bool,):
            parser.add_argument(f"--{name.replace('_', '-')}", action="store_const", const=True, help=key.about)
            continue
        parser.add_argument(f"--{name.replace('_', '-')}", type=number if {int, float} & {*key.kinds} else str,
                            metavar=VALUES.get(name, None if key.choices else "N"),
                            choices=None if name in VALUES else key.choices or None, help=key.about + unit + default)


def add_photon_file(parser: argparse.ArgumentParser, **several: str) -> None:
    """Add INPUT, `several` of which nargs="+" allows, and the options that choose its frame and describe its sensor."""
    parser.add_argument("input", metavar="INPUT", **several,
                        help="photon file (.npz, .npy, .mat, .csv, .h5, .ptu, .phu, .sdt, .spc, a log of histograms: "
                             "docs/photon-file.md), bag (docs/bags.md), or: simulator")
    parser.add_argument("--frame", type=int, default=0, metavar="N",
                        help="number of the photon message in a bag, from 0 (default: 0)")
    parser.add_argument("--photons-topic", default="", metavar="TOPIC",
                        help="topic of the photons, if a bag has several")
    sensor = parser.add_argument_group("sensor options (what the file lacks; they override it)")
    add_sensor_file(sensor)
    add_options(sensor, on_command_line())


def on_command_line() -> dict[str, "Key"]:
    """The options of `datasets.read` that the command line has, by name."""
    from srt3d_ros.datasets.options import option_keys  # imported here, as NumPy and numba are slow

    return {name: key for name, key in option_keys().items() if key.option}


def add_gate(parser: argparse.ArgumentParser) -> None:
    """Add --gate of commands that take no `auto`."""
    parser.add_argument("--gate", default="off", metavar="FIRST-LAST",
                        help="use only the photons in bins FIRST to LAST (default: off)")


def read_photons(args: argparse.Namespace, path: str, **more: bool) -> "Reading":
    """The photons of INPUT at `path`, as the options say; `more` as of `datasets.read_photons`."""
    from srt3d_ros import datasets

    return datasets.read_photons(path, args.frame, args.photons_topic, **more, **overrides(args))


def add_sensor_file(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--sensor-file", metavar="FILE",
                       help="the whole sensor, with defaults for what it leaves out: .json as in config/sensors/, or "
                            "a photon file; the other options override it")


def given_sensor(args: argparse.Namespace) -> dict[str, object]:
    """`sensor` for `datasets.read`, if there is a --sensor-file."""
    from srt3d_ros.datasets import open_sensor

    return {} if args.sensor_file is None else {"sensor": open_sensor(args.sensor_file)}


def overrides(args: argparse.Namespace) -> dict[str, object]:
    """The given options that `datasets.read` takes. A gate of `auto` is left to the reconstruction."""
    from srt3d_ros.core.sketching.gate import AUTO, OFF, parse

    options, bins = given_sensor(args) | given(args, on_command_line()), parse(args.gate)
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
