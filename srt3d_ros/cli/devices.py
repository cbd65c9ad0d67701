"""`srt3d devices`: the sensors whose own streams and logs are read."""

import argparse
import json

from srt3d_ros.cli import common


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "devices", help="list the sensors whose own streams and logs are read",
        description="List the sensors whose own streams and logs are read. docs/devices.md says what is verified.")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.devices import DEVICES

    extras = {name: "pip install 'srt3d_ros[devices]' to connect" if device.decode else ""
              for name, device in DEVICES.items()}
    if args.json:
        print(json.dumps([{"name": name, "sensor": device.sensor, "reads": device.reads, "needs": extras[name]}
                          for name, device in DEVICES.items()]))
        return 0
    for name, device in DEVICES.items():
        print(f"{name:<10}{device.sensor}\n{'':10}{device.reads}" + f"\n{'':10}{extras[name]}" * bool(extras[name]))
    return 0
