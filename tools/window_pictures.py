"""Draw what windows of a sensor that moves show, and how an object that moves smears:
python -m tools.window_pictures docs/images/window.png docs/images/window_smear.png"""

import sys
from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.motion import LAP, Walk
from srt3d_ros.core.motion.moving_sketcher import MovingSketcher
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.reconstruction import Reconstructor

FRAMES, PPP, RATE_HZ = range(LAP - 9, LAP + 6), 0.2, 10.0
WALK = Walk(FRAMES)
RAYS = WALK.sensor.rays


class Crossing:
    """A disc that crosses the view at 0.5 m/s before a wall, 2 and 3 m away; a scene.Scene."""

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        x, y = RAYS[..., 0] / RAYS[..., 2] * 2, RAYS[..., 1] / RAYS[..., 2] * 2
        z = np.where((x + 0.4 - 0.5 * t_s)**2 + y**2 < 0.3**2, 2.0, 3.0)
        return (z / RAYS[..., 2])[None].astype(np.float32), np.ones((1, *z.shape), np.float32)


def draw(path: str, sketches: Iterable[PhaseSums], trajectory: Trajectory | None) -> None:
    """Write range images of the last frame beside each other: of one frame, and of ten."""
    makers = {n: Reconstructor(WALK.sensor, WALK.frequencies, device="cpu", window_frames=n) for n in (1, 10)}
    for sketch in sketches:
        images = [make(sketch, trajectory if n > 1 else None).range_image() for n, make in makers.items()]
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.9), facecolor="#0e1117")
    low, high = np.nanpercentile(images[1], [1, 99])
    for ax, image, title in zip(axes, images, ("one frame", "ten frames"), strict=True):
        ax.imshow(image, "turbo_r", vmin=low, vmax=high)
        ax.set(title=title, xticks=[], yticks=[], facecolor="black")
        ax.title.set_color("white")
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.92, wspace=0.02)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    sketcher, moving = MovingSketcher(WALK.sensor, WALK.frequencies), WALK.moving(PPP)
    draw(sys.argv[1], (sketcher.finish(WALK.frame(k, moving), WALK.trajectory) for k in FRAMES), WALK.trajectory)
    crossing = Simulator(Crossing(), WALK.sensor, 1.0, PPP, 0, RATE_HZ)
    draw(sys.argv[2], (sketch_photons(crossing.frame(k)[0], WALK.sensor, WALK.frequencies) for k in range(15)), None)
