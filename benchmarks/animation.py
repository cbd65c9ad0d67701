"""The clouds of a person who walks through a room, as an animated WebP: photons added as they are, and moved first.

The simulated frames are those of `python -m benchmarks motion`. Lines: mean depth error (DAE) and true detections.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.motion import FRAME_S, TOLERANCE_BINS, Views, methods, moving_frame
from benchmarks.relief import trajectory
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.metrics import Metrics, evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.datasets.simulation.motion_profiles import walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.pictures import annotations
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.viewpoint import Viewpoint, point_radius_m

HEADINGS = {"not_moved": "photons added", "moved": "parts of the frame moved first (deskewed)"}
EYE = Viewpoint(np.array([1.1, -0.5, -0.3]), np.array([0.05, 0.1, 2.6]), np.array([0.0, -1, 0]), fov_deg=46)
NEAR_M, FAR_M, RADIUS_FACTOR = 1.0, 4.5, 1.2
SIDE_PX, TOP_PX = 480, 44           # of a panel; of its heading
FIRST_S = 3.2                       # of the walk, which then passes two busts
QUALITY = 55                        # of WebP: 1.3 MB for 50 frames


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--picture", type=Path, metavar="FILE", required=True, help="write the clouds here, .webp")
    parser.add_argument("--ppp", type=float, default=10.0, help="photons a pixel and frame (%(default)g)")
    parser.add_argument("--frames", type=int, default=50, help="so many (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each way to a cloud: means over the frames."""
    pictures, found = [], {name: [] for name in HEADINGS}
    for clouds, metrics, sensor in shots(args.ppp, args.frames):
        pictures.append(draw(clouds, sensor))
        for name, one in metrics.items():
            found[name].append(one)
    pictures[0].save(args.picture, save_all=True, append_images=pictures[1:], duration=round(FRAME_S * 1e3), loop=0,
                     quality=QUALITY, method=6)
    for name, judged in found.items():
        means = np.mean([(one.true_detections, one.dae_bins) for one in judged], axis=0)
        yield {"method": name, "ppp": args.ppp, "frames": args.frames, "td_percent": round(100 * means[0], 2),
               "dae_bins": round(means[1], 3), "bytes": args.picture.stat().st_size}


def shots(ppp: float, frames: int) -> Iterator[tuple[dict[str, Cloud], dict[str, Metrics], SensorModel]]:
    """Of each frame: the clouds, and what they are worth, by method."""
    sensor = moving_sensor()
    view, frequencies = MovingView(Room(), walk, sensor), choose("auto", sensor)
    ways = methods(sensor, frequencies, trajectory(view.sensor_pose, FIRST_S, FIRST_S + frames * FRAME_S))
    for k in range(frames):
        first_s = FIRST_S + k * FRAME_S
        frame = moving_frame(Views(view, first_s), sensor, frequencies, first_s, ppp, k)
        truth = sensor.depth_bins(view.at(first_s + FRAME_S / 2)[0])
        clouds = {name: way.cloud(frame) for name, way in ways.items()}
        yield clouds, {name: evaluate(cloud, truth, TOLERANCE_BINS, sensor.num_bins)
                       for name, cloud in clouds.items()}, sensor


def draw(clouds: dict[str, Cloud], sensor: SensorModel) -> Image.Image:
    """The clouds side by side, seen from behind the sensor, at its right and above."""
    width, height = SIDE_PX * len(HEADINGS), SIDE_PX + TOP_PX
    figure = annotations.dark_figure(width, height)
    for k, (name, heading) in enumerate(HEADINGS.items()):
        style = CloudStyle(NEAR_M, FAR_M, RADIUS_FACTOR * point_radius_m(clouds[name].xyz, sensor))
        axes = annotations.image_axes(figure, (k / len(HEADINGS), 0, 1 / len(HEADINGS), SIDE_PX / height),
                                      style.draw(clouds[name], EYE, SIDE_PX, SIDE_PX))
        figure.text((k + 0.03) / len(HEADINGS), 1 - 0.5 * TOP_PX / height, heading, color=annotations.TEXT, size=12,
                    va="center")
        annotations.range_bar(axes, style, 9)
    return annotations.as_image(figure)
