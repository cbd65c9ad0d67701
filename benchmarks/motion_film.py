"""Records a sensor that moves through the simulator's room (.rrd): its way, and two clouds of each frame in two views.

Left the photons of each frame are simply added, right its parts are moved to one instant before. 15 frames are
shown at once, each where the sensor was. Open it with `srt3d view`.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from benchmarks.motion import FRAME_S, Views, methods, part_sketches
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.moving_sketcher import MovingFrame
from srt3d_ros.datasets.motion_profiles import MOTIONS, trajectory
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
    sensor = moving_sensor()
    view, frequencies = MovingView(Room(), MOTIONS[args.motion], sensor), choose("auto", sensor)
    known = trajectory(view.sensor_pose, 0.0, args.frames * FRAME_S)
    ways = methods(sensor, frequencies, "middle", known, known)
    for k in tqdm(range(args.frames), unit="frame"):
        first_s = k * FRAME_S
        parts = part_sketches(Views(view, first_s), sensor, frequencies, first_s, args.ppp, k)
        first_ns, middle_ns, last_ns = (round((first_s + share * FRAME_S) * 1e9) for share in (0, 0.5, 1))
        frame = MovingFrame(parts, first_ns, last_ns, middle_ns)
        yield Moment(middle_ns, view.sensor_pose(first_s + FRAME_S / 2),
                     {title: ways[name].cloud(frame) for title, name in SHOWN.items()})
