"""Records a sensor that moves through the simulator's room (.rrd): its way, and two clouds of each frame in two views.

Left the photons of each frame are simply added, right its parts are moved to one instant before. 15 frames are
shown at once, each where the sensor was. Open it with `srt3d view`.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from benchmarks.motion import along
from srt3d_ros.datasets.motion_profiles import MOTIONS
from srt3d_ros.datasets.moving import MovingView, moving_sensor
from srt3d_ros.datasets.room import Room
from srt3d_ros.recording.motion_film import Moment, write_film

SHOWN = {"photons added": "not_moved", "parts moved": "moved"}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE.rrd")
    parser.add_argument("--motion", choices=tuple(MOTIONS), default="drone", help="(%(default)s)")
    parser.add_argument("--frames", type=int, default=100, help="of 0.1 s (%(default)d)")
    parser.add_argument("--ppp", type=float, default=10.0, help="photons a pixel and frame (%(default)g)")


def run(args: argparse.Namespace) -> tuple:
    """Write the film; there are no lines."""
    write_film(args.file, _moments(args), tuple(SHOWN), (0.0, 2.6), (0.0, 0.0, 1.0))
    return ()


def _moments(args: argparse.Namespace) -> Iterator[Moment]:
    view = MovingView(Room(), MOTIONS[args.motion], moving_sensor())
    for stamp_ns, clouds in along(view, args.frames, args.ppp, tuple(SHOWN.values())):
        yield Moment(stamp_ns, view.sensor_pose(stamp_ns / 1e9), {title: clouds[name] for title, name in SHOWN.items()})
