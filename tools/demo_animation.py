"""Draw docs/images/demo.webp: the photons of a frame of `srt3d demo`, then its points, from a view that sways.

    python -m tools.demo_animation docs/images/demo.webp
"""

import sys
from collections.abc import Iterator

import numpy as np
from PIL import Image

from srt3d_ros.cli.demo import SCENE, SIMULATED_TOLERANCE_M
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.stream import SketchStream
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.pictures import annotations
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.figures import as_image
from srt3d_ros.pictures.overview import draw_photons, photon_positions
from srt3d_ros.pictures.viewpoint import look_at
from srt3d_ros.reconstruction import Reconstructor

FRAME, EARLIER = 30, 3              # the frame that is drawn, and those before it, which tell the background
WIDTH, HEIGHT, TOP = 880, 640, 76   # pixels; TOP: of the title
YAW_DEG, SWAY_DEG = 12.0, 16.0
PHOTONS, FADE, POINTS = 14, 3, 44   # pictures; a fade leads from each to the other
PERIOD_MS, QUALITY = 110, 28        # below 2 MB; photons take most of it
NOTES = "photons, each at its pixel and time of arrival", "points, coloured by range (black: hidden from the sensor)"


def main() -> None:
    simulator = Simulator(**SCENE)
    sensor, stream = simulator.sensor, SketchStream(simulator.sensor)
    reconstruct = Reconstructor(sensor, choose_frequencies("auto", sensor))
    for k in range(FRAME - EARLIER, FRAME + 1):
        photons, truth = simulator.frame(k)
        sketch, = stream.push(photons)
        cloud = reconstruct(sketch)
    tolerance_bins = SIMULATED_TOLERANCE_M / sensor.bin_width_m
    error_mm = evaluate(cloud, truth, tolerance_bins, sensor.num_bins).dae_bins * sensor.bin_width_m * 1e3
    title = f"{photons.photons:,} photons → {len(cloud):,} points, {error_mm:.1f} mm mean error"
    first, *others = pictures(photons, cloud, title)
    first.save(sys.argv[1], save_all=True, append_images=others, duration=PERIOD_MS, loop=0, quality=QUALITY, method=6)


def pictures(photons: PhotonEvents, cloud: PointCloud, title: str) -> Iterator[Image.Image]:
    """The pictures of one period."""
    fade = np.linspace(0, 1, FADE + 2)[1:-1]
    points_share = np.concatenate([np.zeros(PHOTONS), fade, np.ones(POINTS), fade[::-1]])
    style, xyz, height = CloudStyle.of(cloud, cloud.sensor), photon_positions(photons, cloud.sensor), HEIGHT - TOP
    for k, share in enumerate(points_share):
        yaw_deg = YAW_DEG + SWAY_DEG * np.sin(2 * np.pi * k / len(points_share))
        eye = look_at(cloud.xyz, cloud.sensor.projection, yaw_deg, aspect=WIDTH / height)
        image = np.zeros((height, WIDTH, 3))
        if share < 1:
            fog = Image.fromarray(draw_photons(xyz, style, eye, 2 * WIDTH, 2 * height))
            image += (1 - share) * np.asarray(fog.reduce(2))
        if share > 0:
            image += share * style.draw(cloud, eye, WIDTH, height)
        figure = annotations.dark_figure(WIDTH, HEIGHT)
        annotations.write_line(figure, 1 - 0.32 * TOP / HEIGHT, title, 20, annotations.TEXT_COLOUR, weight="bold")
        annotations.write_line(figure, 1 - 0.78 * TOP / HEIGHT, NOTES[round(share)], 15, annotations.DIM_COLOUR)
        axes = annotations.image_axes(figure, (0, 0, 1, height / HEIGHT), image.astype(np.uint8))
        annotations.range_bar(axes, style, 15)
        annotations.scale_bar(axes, eye, 15)
        yield as_image(figure)


if __name__ == "__main__":
    main()
