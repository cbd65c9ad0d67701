"""Drift of KISS-ICP on the clouds of a sensor that flies through the simulator's room (pip install kiss-icp).

A line for the exact ranges at the instants of the frames, for frames whose photons are simply added, and for frames
that are moved by exact odometry first. KISS-ICP sees clouds only. Drift: mean error of all ways of 10, 20 and 40 m.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.motion import FRAME_S, along
from srt3d_ros.core.motion import Pose
from srt3d_ros.datasets.motion_profiles import MOTIONS
from srt3d_ros.datasets.moving import MovingView, moving_sensor
from srt3d_ros.datasets.room import Room

SIDE, FOV_DEG, PPP = 101, 90.0, 10.0        # it needs a wide field of view
VOXEL_M, MAX_RANGE_M = 0.05, 12.0
# Of its adaptive threshold, within which points belong together. By default it does not adapt to motions within 10 cm:
# what comes into view is then matched with the edge of what is known, and the trajectory shrinks.
FIRST_THRESHOLD_M, LEAST_MOTION_M = 0.1, 0.001
WAYS_M = 10.0, 20.0, 40.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--motion", choices=tuple(MOTIONS), default="walk", help="(%(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="(%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each kind of clouds; one that says why there is none without kiss-icp."""
    try:
        import kiss_icp  # noqa: F401
    except ModuleNotFoundError:
        yield {"skipped": "kiss-icp is not installed"}
        return
    view, poses = MovingView(Room(), MOTIONS[args.motion], moving_sensor(SIDE, FOV_DEG)), []
    clouds: dict[str, list[np.ndarray]] = {"exact": [], "not_moved": [], "moved": []}
    for stamp_ns, found in along(view, int(args.seconds / FRAME_S), PPP, ("not_moved", "moved")):
        poses.append(view.sensor_pose(stamp_ns / 1e9))
        clouds["exact"].append((view.sensor.rays * view.at(stamp_ns / 1e9)[0][..., None]).reshape(-1, 3))
        for name, cloud in found.items():
            clouds[name].append(cloud.xyz)
    for name, seen in clouds.items():
        drift, length_m = drift_percent(followed(seen), poses)
        yield {"motion": args.motion, "clouds": name, "ppp": PPP, "way_m": round(length_m, 1),
               "drift_percent": round(drift, 2)}


def followed(clouds: list[np.ndarray]) -> list[Pose]:
    """Where KISS-ICP takes the sensor to be at each cloud."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP
    config = KISSConfig()
    config.mapping.voxel_size = VOXEL_M
    config.adaptive_threshold.initial_threshold, config.adaptive_threshold.min_motion_th = (
        FIRST_THRESHOLD_M, LEAST_MOTION_M)
    config.data.max_range, config.data.deskew = MAX_RANGE_M, False
    config.registration.max_num_threads = 1
    odometry, poses = KissICP(config), []
    for xyz in clouds:
        odometry.register_frame(np.ascontiguousarray(xyz, np.float64), np.zeros(0))
        poses.append(Pose(odometry.last_pose[:3, :3].copy(), odometry.last_pose[:3, 3].copy()))
    return poses


def drift_percent(found: list[Pose], true: list[Pose]) -> tuple[float, float]:
    """Mean error of the ways of WAYS_M, percent of them, and the length of the whole way, m."""
    steps = np.linalg.norm(np.diff([pose.translation for pose in true], axis=0), axis=1)
    far, errors = np.concatenate([[0], np.cumsum(steps)]), []
    for way_m in WAYS_M:
        for first, last in enumerate(np.searchsorted(far, far + way_m)):
            if last < len(far):
                off = (found[first].inverse() @ found[last]).inverse() @ true[first].inverse() @ true[last]
                errors.append(np.linalg.norm(off.translation) / way_m)
    return 100 * float(np.mean(errors)), float(far[-1])
