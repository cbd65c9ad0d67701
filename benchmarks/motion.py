"""Depth error of a sensor that moves: at rest, with photons added as they are, and deskewed first.

A person carries the sensor through the simulated room at 1 m/s and 30°/s. Frames last 100 ms and have ten parts, each
drawn from three exact views. Clouds are judged against the exact depths in the middle of the frame. A line
has the true and false detections (TD, FD; %) within 10 bins, the depth error (DAE, bins), and that of the points near
edges, means over the frames:

    at_rest     the sensor stands still where it is in the middle of the frame
    not_moved   the photons of the frame are added as they are
    moved       the parts are moved to the middle of the frame by the exact trajectory, then added
    window_3, window_10     the same, with windows of 3 and 10 frames that follow the trajectory
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from tqdm import tqdm

from benchmarks.frames import SKETCH_SIZE
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.motion.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator

FIRST_S = 6.55              # of the walk, in which a bust then comes near
FRAME_S, PARTS, VIEWS = 0.1, 10, 3          # of a frame; views of a part
VIEW_S = FRAME_S / PARTS / VIEWS
TOLERANCE_BINS = 10.0
NEAR_EDGE, STEP_BINS = 5, 20.0      # pixels across in which depths differ by so much at an edge
WARM_UP = 9                 # frames before those that are judged
MARGIN_S = 0.1              # of the trajectory before and after the frames; odometry comes every 0.01 s
WAYS = {"at_rest": 1, "not_moved": 1, "moved": 1, "window_3": 3, "window_10": 10}       # frames of a window


class Views:
    """What the moving sensor sees during one frame, rendered once for every number of photons; a scene.Scene."""

    def __init__(self, view: MovingView, first_s: float):
        seen = [view.at(first_s + (k + 0.5) * VIEW_S) for k in range(PARTS * VIEWS)]
        self._seen = [(range_m[None], reflectivity[None]) for range_m, reflectivity in seen]

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """What is seen so many seconds after the frame has begun."""
        return self._seen[round(t_s / VIEW_S)]


class Walk:
    """The walk of a sensor through the room: the frames that it records, the truth, and its exact trajectory."""

    def __init__(self, frames: int):
        self.sensor = moving_sensor()
        self.frequencies = choose_frequencies("auto", self.sensor, SKETCH_SIZE)
        self.trajectory = Trajectory()
        self._view = MovingView(Room(), walk, self.sensor)
        for report in measured(walk, start_s=FIRST_S - MARGIN_S):
            self.trajectory.add(round(report.at_s * 1e9), report.pose @ OPTICAL)
            if report.at_s > FIRST_S + frames * FRAME_S + MARGIN_S:
                break

    def views(self, k: int) -> Views:
        """What the sensor sees during frame k."""
        return Views(self._view, FIRST_S + k * FRAME_S)

    def at_middle(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Range (m) and reflectivity [rows, cols] in the middle of frame k."""
        return self._view.at(FIRST_S + (k + 0.5) * FRAME_S)

    def frame(self, k: int, views: Views, ppp: float, seed: int, sbr: float = 1.0) -> MovingFrame:
        """Frame k in parts, not yet moved, with `ppp` photons per pixel that `seed` draws from these views."""
        simulator = Simulator(views, self.sensor, sbr, ppp / PARTS / VIEWS, seed, 1 / VIEW_S)
        sketcher, parts, first_s = FrameSketcher(self.sensor, self.frequencies), [], FIRST_S + k * FRAME_S
        for part in range(PARTS):
            for view in range(VIEWS):
                sketcher.add(simulator.frame(part * VIEWS + view)[0])
            parts.append((round((first_s + (part + 0.5) * FRAME_S / PARTS) * 1e9), sketcher.end_frame()))
        first, middle, last = (round((first_s + share * FRAME_S) * 1e9) for share in (0, 0.5, 1))
        return MovingFrame(parts, first, last, middle)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ppp", type=float, nargs="+", default=[3.0, 10.0], help="photons per pixel and frame")
    parser.add_argument("--sbr", type=float, default=1.0, help="signal to background ratio (%(default)s)")
    parser.add_argument("--frames", type=int, default=10, help="frames to judge (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each number of photons and way."""
    frames = WARM_UP + args.frames
    walked, found = Walk(frames), defaultdict(list)
    sensor, frequencies = walked.sensor, walked.frequencies
    pooled = {(ppp, way): Pooled(sensor, frequencies, window_frames=W) for ppp in args.ppp for way, W in WAYS.items()}
    sketcher = MovingSketcher(sensor, frequencies)
    for k in tqdm(range(frames), unit="frame", leave=False):
        views, (range_m, reflectivity) = walked.views(k), walked.at_middle(k)
        truth = sensor.depth_bins(range_m)
        for ppp in args.ppp:
            at_rest = Simulator(StaticScene(range_m, reflectivity), sensor, args.sbr, ppp, k).frame(0)[0]
            frame = walked.frame(k, views, ppp, k, args.sbr)
            sketches = {"at_rest": sketch_photons(at_rest, sensor, frequencies),
                        "not_moved": sketcher.finish(frame, None)}
            moved = sketcher.finish(frame, walked.trajectory)
            for way, window_frames in WAYS.items():
                cloud = pooled[ppp, way](sketches.get(way, moved), walked.trajectory if window_frames > 1 else None)
                if k >= WARM_UP:
                    found[ppp, way].append(judged(cloud, truth))
    for (ppp, way), metrics in found.items():
        td, fd, dae, edge = np.nanmean(metrics, axis=0)
        yield {"scene": "room", "ppp": ppp, "sbr": args.sbr, "method": way, "td_percent": round(100 * td, 2),
               "fd_percent": round(100 * fd, 2), "dae_bins": round(dae, 3), "edge_dae_bins": round(edge, 3),
               "frames": len(metrics)}


def judged(cloud: PointCloud, truth: np.ndarray) -> tuple[float, float, float, float]:
    """True and false detections, DAE, and DAE near edges."""
    one = evaluate(cloud, truth, TOLERANCE_BINS, cloud.sensor.num_bins)
    steps = maximum_filter(truth, NEAR_EDGE) - minimum_filter(truth, NEAR_EDGE)
    error = np.abs(cloud.depth_bins - truth[cloud.row, cloud.col])
    near = (steps[cloud.row, cloud.col] > STEP_BINS) & (error < TOLERANCE_BINS)
    return one.true_detections, one.false_detections, one.dae_bins, error[near].mean() if near.any() else np.nan
