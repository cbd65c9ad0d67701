"""Depth error of a sensor that moves: at rest, with photons added as they are, and deskewed first.

A person carries the sensor through the simulated room at 1 m/s and 30°/s, in constant light. Frames last 100 ms with
ten parts, each drawn from three exact views. Clouds are judged against the truth in the middle of the frame. A line
has the true and false detections (TD, FD; %) within 10 bins, the depth error (DAE, bins), and that of the points near
edges, means over the frames; and the medians of intensity and background over the truth:

    at_rest     the sensor stands still where it is in the middle of the frame
    not_moved   the photons of the frame are added as they are
    moved       the parts are moved to the middle of the frame by the exact trajectory, then added
    window_3, window_10     the same, with windows of 3 and 10 frames that follow the trajectory
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from tqdm import tqdm

from benchmarks.frames import SKETCH_SIZE
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.motion.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.datasets.simulation.motion_profiles import LAP_S, OPTICAL, measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.scene import Scene
from srt3d_ros.datasets.simulation.simulator import Simulator

FIRST_S = 7.45              # of the walk, in which a bust comes near
FRAME_S, PARTS, VIEWS = 0.1, 10, 3          # of a frame; views of a part
VIEW_S = FRAME_S / PARTS / VIEWS
TOLERANCE_BINS = 10.0
NEAR_EDGE, STEP_BINS = 5, 20.0      # pixels across in which depths differ by so much at an edge
WARM_UP = 9                 # frames before those that are judged
LAP = round(LAP_S / FRAME_S)        # the first frame to judge: it sees what frame 0 does, for which ppp and SBR hold
MARGIN_S = 0.1              # of the trajectory before and after the frames; odometry comes every 0.01 s
WAYS = {"at_rest": 1, "not_moved": 1, "moved": 1, "window_3": 3, "window_10": 10}       # frames of a window


class Walk:
    """The walk of a sensor through the room: the frames that it records, the truth, and its exact trajectory."""

    def __init__(self, frames: range):
        self.sensor = moving_sensor()
        self.frequencies = choose_frequencies("auto", self.sensor, SKETCH_SIZE)
        self.trajectory = Trajectory()
        for report in measured(path, start_s=frames.start * FRAME_S - MARGIN_S):
            self.trajectory.add(round(report.at_s * 1e9), report.pose @ OPTICAL)
            if report.at_s > frames.stop * FRAME_S + MARGIN_S:
                break
        self._views, self._middles = (self._seen(duration_s) for duration_s in (VIEW_S, FRAME_S))

    def _seen(self, duration_s: float) -> Scene:
        """What the sensor sees in the middle of each such duration; each is rendered once."""
        view = MovingView(Room(), path, self.sensor, duration_s)
        return SimpleNamespace(frame=lru_cache(2 * PARTS * VIEWS)(view.frame))

    def moving(self, ppp: float, sbr: float = 1.0, seed: int = 0) -> Simulator:
        """Draws the photons of view after view, `ppp` photons per pixel in a frame."""
        return Simulator(self._views, self.sensor, sbr, ppp / PARTS / VIEWS, seed, 1 / VIEW_S)

    def at_rest(self, ppp: float, sbr: float = 1.0) -> Simulator:
        """Draws frames of a sensor that stands still where it is in the middle of each; tells the truth."""
        return Simulator(self._middles, self.sensor, sbr, ppp, 0, 1 / FRAME_S)

    def frame(self, k: int, moving: Simulator) -> MovingFrame:
        """Frame k in parts, not yet moved."""
        sketcher, parts = FrameSketcher(self.sensor, self.frequencies), []
        for part in range(k * PARTS, (k + 1) * PARTS):
            for view in range(VIEWS):
                sketcher.add(moving.frame(part * VIEWS + view)[0])
            parts.append((round((part + 0.5) * FRAME_S / PARTS * 1e9), sketcher.end_frame()))
        first, middle, last = (round((k + share) * FRAME_S * 1e9) for share in (0, 0.5, 1))
        return MovingFrame(parts, first, last, middle)


def path(t_s: float) -> Pose:
    """The walk from FIRST_S on."""
    return walk(FIRST_S + t_s)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ppp", type=float, nargs="+", default=[3.0, 10.0], help="photons per pixel and frame")
    parser.add_argument("--sbr", type=float, default=1.0, help="signal to background ratio (%(default)s)")
    parser.add_argument("--frames", type=int, default=10, help="frames to judge (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each number of photons and way."""
    frames = range(LAP - WARM_UP, LAP + args.frames)
    walked, found = Walk(frames), defaultdict(list)
    sensor, frequencies = walked.sensor, walked.frequencies
    pooled = {(ppp, way): Pooled(sensor, frequencies, window_frames=W) for ppp in args.ppp for way, W in WAYS.items()}
    simulators = {ppp: (walked.at_rest(ppp, args.sbr), walked.moving(ppp, args.sbr)) for ppp in args.ppp}
    sketcher = MovingSketcher(sensor, frequencies)
    for k in tqdm(frames, unit="frame", leave=False):
        for ppp, (at_rest, moving) in simulators.items():
            frame = walked.frame(k, moving)
            sketches = {"at_rest": sketch_photons(at_rest.frame(k)[0], sensor, frequencies),
                        "not_moved": sketcher.finish(frame, None)}
            moved = sketcher.finish(frame, walked.trajectory)
            for way, window_frames in WAYS.items():
                cloud = pooled[ppp, way](sketches.get(way, moved), walked.trajectory if window_frames > 1 else None)
                if k >= LAP:
                    found[ppp, way].append(judged(cloud, *at_rest.expected(k)))
    for (ppp, way), metrics in found.items():
        td, fd, dae, edge, intensity, background = np.nanmean(metrics, axis=0)
        yield {"scene": "room", "ppp": ppp, "sbr": args.sbr, "method": way, "td_percent": round(100 * td, 2),
               "fd_percent": round(100 * fd, 2), "dae_bins": round(dae, 3), "edge_dae_bins": round(edge, 3),
               "intensity": round(intensity, 3), "background": round(background, 3), "frames": len(metrics)}


def judged(cloud: PointCloud, depth: np.ndarray, signal: np.ndarray, background: np.ndarray) -> tuple[float, ...]:
    """True and false detections, DAE, DAE near edges, and medians of intensity and background over the truth."""
    truth, place = depth[0], (cloud.row, cloud.col)
    one = evaluate(cloud, truth, TOLERANCE_BINS, cloud.sensor.num_bins)
    steps = maximum_filter(truth, NEAR_EDGE) - minimum_filter(truth, NEAR_EDGE)
    error = np.abs(cloud.depth_bins - truth[place])
    right = error < TOLERANCE_BINS
    near = (steps[place] > STEP_BINS) & right
    return (one.true_detections, one.false_detections, one.dae_bins, error[near].mean() if near.any() else np.nan,
            np.median((cloud.intensity / signal[0][place])[right]), np.median(cloud.background / background))
