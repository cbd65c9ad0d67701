"""Draw what windows of a sensor that moves show, and how an object that moves smears:
python -m tools.window_pictures docs/images/window.png docs/images/window_smear.png"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from srt3d_ros.core.motion.moving_sketcher import MovingSketcher
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.reconstruction import Reconstructor

FIRST_S, FRAMES, PACKETS, RATE_HZ = 6.55, 15, 10, 100.0
SENSOR = moving_sensor()


class Crossing:
    """A disc that crosses the view at 0.5 m/s before a wall, 2 and 3 m away; a scene.Scene."""

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        x, y = SENSOR.rays[..., 0] / SENSOR.rays[..., 2] * 2, SENSOR.rays[..., 1] / SENSOR.rays[..., 2] * 2
        z = np.where((x + 0.4 - 0.5 * t_s)**2 + y**2 < 0.3**2, 2.0, 3.0)
        return (z / SENSOR.rays[..., 2])[None].astype(np.float32), np.ones((1, *z.shape), np.float32)


def clouds(simulator: Simulator, trajectory: Trajectory | None) -> list[np.ndarray]:
    """Range images of the last frame: of one frame, and of ten."""
    frequencies = choose_frequencies("auto", SENSOR, 10)
    sketcher = MovingSketcher(SENSOR, frequencies)
    makers = {n: Reconstructor(SENSOR, frequencies, device="cpu", window_frames=n) for n in (1, 10)}
    seen = {}
    for k in range(FRAMES):
        for packet in range(PACKETS):
            sketcher.add(simulator.frame(k * PACKETS + packet)[0])
        sketch = sketcher.finish(sketcher.end_frame(), trajectory)
        seen = {n: make(sketch, trajectory if n > 1 else None).range_image() for n, make in makers.items()}
    return [*seen.values()]


def draw(path: str, images: list[np.ndarray]) -> None:
    """Write range images beside each other."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.9), facecolor="#0e1117")
    low, high = np.nanpercentile(images[1], [1, 99])
    for ax, image, title in zip(axes, images, ("one frame", "ten frames"), strict=True):
        ax.set_facecolor("black")
        ax.imshow(image, "turbo_r", vmin=low, vmax=high)
        ax.set_title(title, color="white")
        ax.set_xticks([])
        ax.set_yticks([])
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.92, wspace=0.02)
    figure.savefig(Path(path), dpi=110)


if __name__ == "__main__":
    trajectory = Trajectory()
    for report in measured(walk, start_s=FIRST_S - 0.2):
        trajectory.add(round((report.at_s - FIRST_S) * 1e9), report.pose @ OPTICAL)
        if report.at_s > FIRST_S + FRAMES * PACKETS / RATE_HZ + 0.2:
            break
    view = MovingView(Room(), lambda t_s: walk(FIRST_S + t_s), SENSOR, 1 / RATE_HZ)
    for path, scene, motion in zip(sys.argv[1:], (view, Crossing()), (trajectory, None)):
        draw(path, clouds(Simulator(scene, SENSOR, 1.0, 0.2 / PACKETS, 0, RATE_HZ), motion))
