"""Drift of KISS-ICP on the clouds of a sensor that flies through the simulator's room (pip install kiss-icp).

A line for the exact ranges at the instants of the frames, for frames whose photons are simply added, and for frames
that are moved by exact odometry first. KISS-ICP sees clouds only. Drift: mean error of all ways of 5 m.
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
VOXEL_M, FIRST_THRESHOLD_M, MAX_RANGE_M = 0.05, 0.3, 12.0
WAY_M = 5.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--motion", choices=tuple(MOTIONS), default="drone", help="(%(default)s)")
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
    config.mapping.voxel_size, config.adaptive_threshold.initial_threshold = VOXEL_M, FIRST_THRESHOLD_M
    config.data.max_range, config.data.deskew = MAX_RANGE_M, False
    config.registration.max_num_threads = 1
    odometry, poses = KissICP(config), []
    for xyz in clouds:
        odometry.register_frame(np.ascontiguousarray(xyz, np.float64), np.zeros(0))
        poses.append(Pose(odometry.last_pose[:3, :3].copy(), odometry.last_pose[:3, 3].copy()))
    return poses


def drift_percent(found: list[Pose], true: list[Pose]) -> tuple[float, float]:
    """Mean error of the ways of WAY_M, percent of them, and the length of the whole way."""
    steps = np.linalg.norm(np.diff([pose.translation for pose in true], axis=0), axis=1)
    far, errors = np.concatenate([[0], np.cumsum(steps)]), []
    for first in range(len(far)):
        last = int(np.searchsorted(far, far[first] + WAY_M))
        if last < len(far):
            off = (found[first].inverse() @ found[last]).inverse() @ true[first].inverse() @ true[last]
            errors.append(np.linalg.norm(off.translation) / WAY_M)
    return 100 * float(np.mean(errors)), float(far[-1])
