"""What a sensor's own motion costs, and what is left of it after sketches have been moved to one instant.

A room, and depth maps of --scenes if there are any, seen at 1 m/s and 30°/s; frames of 100 ms in ten parts; SBR 1. Each
part is drawn from several exact views. Clouds are judged against the exact depths from the pose in the middle of the
frame. Lines: true detections (TD) within 10 bins, %, and depth error (DAE), bins, means over the frames:

    at_rest         the sensor stands at that pose
    not_moved       the photons of the frame are simply added
    moved           its parts are moved by the exact trajectory, guided by the range of the last cloud
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
from tqdm import tqdm

from benchmarks.relief import hand, read_relief, trajectory
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.method.memory import PooledStream
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.motion.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import Sketcher, sketch_photons
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.datasets.simulation.motion_profiles import Path, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator

FRAME_S, PARTS, VIEWS = 0.1, 10, 3          # of a frame; views of a part
SBR, TOLERANCE_BINS = 1.0, 10.0
WARM_UP = 9             # frames before those that are judged


@dataclass(frozen=True, eq=False)
class Drive:
    """A sensor that moves through a world.

    Args:
        first_s: when the first frame begins.
    """

    name: str
    world: object       # with cast, as Room
    path: Path
    first_s: float = 0.0


class Views:
    """What a moving sensor sees in one frame, cast once for all photons that are drawn from it."""

    def __init__(self, view: MovingView, first_s: float):
        step_s = FRAME_S / PARTS / VIEWS
        seen = [view.at(first_s + (k + 0.5) * step_s) for k in range(PARTS * VIEWS)]
        self._seen, self._step_s = [(range_m[None], reflectivity[None]) for range_m, reflectivity in seen], step_s

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """See scene.Scene; 0 s is the frame's beginning."""
        return self._seen[round(t_s / self._step_s)]


def drives(scenes: FilePath | None) -> list[Drive]:
    """The room, and the depth maps of a folder."""
    found = sorted(scenes.glob("*.npz")) if scenes else []
    return [Drive("room", Room(), walk, 6.55), *(Drive(path.stem, read_relief(path), hand) for path in found)]


def packets(views: Views, sensor: SensorModel, ppp: float, seed: int) -> Iterator[list[PhotonEvents]]:
    """The photons of each part, so many lists of events."""
    rate_hz = PARTS * VIEWS / FRAME_S
    simulator = Simulator(views, sensor, SBR, ppp / PARTS / VIEWS, seed, rate_hz)
    for part in range(PARTS):
        yield [simulator.frame(part * VIEWS + k)[0] for k in range(VIEWS)]


def part_sketches(views: Views, sensor: SensorModel, frequencies, first_s: float, ppp: float, seed: int
                  ) -> list[tuple[int, Sketch]]:
    """The parts of a frame: the middle of each, ns, and its sketch."""
    sketcher, parts = Sketcher(sensor, frequencies), []
    for part, photons in enumerate(packets(views, sensor, ppp, seed)):
        sketcher.reset()
        for events in photons:
            sketcher.add(events)
        parts.append((round((first_s + (part + 0.5) * FRAME_S / PARTS) * 1e9), sketcher.sketch()))
    return parts


def moving_frame(views: Views, sensor: SensorModel, frequencies, first_s: float, ppp: float, seed: int) -> MovingFrame:
    """A frame in parts, to be moved to its middle."""
    parts = part_sketches(views, sensor, frequencies, first_s, ppp, seed)
    first, middle, last = (round((first_s + share * FRAME_S) * 1e9) for share in (0, 0.5, 1))
    return MovingFrame(parts, first, last, middle)


def at_rest(range_m: np.ndarray, reflectivity: np.ndarray, sensor: SensorModel, frequencies, ppp: float, seed: int
            ) -> Sketch:
    """The sketch of a sensor that stands still."""
    simulator = Simulator(StaticScene(range_m, reflectivity), sensor, SBR, ppp, seed)
    return sketch_photons(simulator.frame(0)[0], sensor, frequencies)


@dataclass
class Method:
    """One way to a cloud: a sketcher that moves frames, or adds them if there is no trajectory."""

    sketcher: MovingSketcher
    pooled: PooledStream
    known: Trajectory | None

    def cloud(self, frame: MovingFrame) -> Cloud:
        """The cloud of the next frame."""
        return self.pooled(self.sketcher.finish(frame, self.known))


def methods(sensor: SensorModel, frequencies, exact: Trajectory) -> dict[str, Method]:
    """The methods by the names of their lines."""
    return {name: Method(MovingSketcher(sensor, frequencies), PooledStream(sensor, frequencies), known)
            for name, known in (("not_moved", None), ("moved", exact))}


def judge(drive: Drive, ppps: list[float], frames: int) -> Iterator[dict]:
    """A line for each number of photons and each method: means over the last frames."""
    sensor = moving_sensor()
    view, frequencies = MovingView(drive.world, drive.path, sensor), choose("auto", sensor)
    last_s = drive.first_s + (WARM_UP + 1 + frames) * FRAME_S
    exact = trajectory(view.sensor_pose, drive.first_s, last_s)
    ways = {ppp: methods(sensor, frequencies, exact) for ppp in ppps}
    still = {ppp: PooledStream(sensor, frequencies) for ppp in ppps}
    found: dict[tuple[float, str], list] = defaultdict(list)
    for k in tqdm(range(WARM_UP + frames), desc=drive.name, unit="frame", leave=False):
        first_s = drive.first_s + k * FRAME_S
        views = Views(view, first_s)
        to_s = first_s + FRAME_S / 2
        range_m, reflectivity = view.at(to_s)
        truth = sensor.depth_bins(range_m)
        for ppp in ppps:
            clouds = {"at_rest": still[ppp](at_rest(range_m, reflectivity, sensor, frequencies, ppp, k))}
            frame = moving_frame(views, sensor, frequencies, first_s, ppp, k)
            clouds |= {name: way.cloud(frame) for name, way in ways[ppp].items()}
            if k >= WARM_UP:
                for name, cloud in clouds.items():
                    found[ppp, name].append(evaluate(cloud, truth, TOLERANCE_BINS, sensor.num_bins))
    for (ppp, name), metrics in found.items():
        means = {key: float(np.mean([getattr(one, key) for one in metrics]))
                 for key in ("true_detections", "false_detections", "dae_bins")}
        yield {"scene": drive.name, "ppp": ppp, "method": name,
               "td_percent": round(100 * means["true_detections"], 2),
               "fd_percent": round(100 * means["false_detections"], 2), "dae_bins": round(means["dae_bins"], 3),
               "frames": len(metrics)}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", type=FilePath, metavar="DIR",
                        help="depth maps, .npz: depth_m (metres along the rays), reflectivity, valid (bool)")
    parser.add_argument("--ppp", type=float, nargs="+", default=[3.0, 10.0], help="photons a pixel and frame")
    parser.add_argument("--frames", type=int, default=10, help="that are judged (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each scene, number of photons and method."""
    for drive in drives(args.scenes):
        yield from judge(drive, args.ppp, args.frames)
