"""Time to move the parts of a frame to one instant; every pixel has photons."""

import argparse
from collections.abc import Iterator
from time import perf_counter

import numpy as np

from srt3d_ros.core.motion.deskew import Deskewer
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.datasets.simulation.scene import default_sensor

FRAME_NS = 100_000_000
WARM_UP = 10            # frames that are not timed
TURN_RAD_S, SPEED_M_S = np.radians(30), 1.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--size", type=int, default=141, help="rows and columns (%(default)d)")
    parser.add_argument("--parts", type=int, default=10, help="of a frame (%(default)d)")
    parser.add_argument("--frames", type=int, default=100, help="that are timed (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    side, rng = args.size, np.random.default_rng(0)
    sensor = default_sensor().replace(rows=side, cols=side, projection=Pinhole.from_fov(side, side, 55.0))
    frequencies = choose("auto", sensor)
    trajectory = Trajectory()
    for k in range((args.frames + WARM_UP + 2) * 10):
        seconds = k / 100
        trajectory.add(k * FRAME_NS // 10, Pose(Pose.turned([0, TURN_RAD_S * np.sin(seconds), 0]).rotation,
                                                np.array([SPEED_M_S * np.sin(seconds), 0, 0])))
    sketches = [_sketch(rng, sensor, frequencies) for _ in range(args.parts)]
    range_m = np.broadcast_to(np.linspace(2, 3, side, dtype=np.float32), (side, side))
    deskewer = Deskewer(sensor, frequencies)
    moved_ms = []
    for frame in range(WARM_UP + args.frames):
        first = frame * FRAME_NS
        parts = [(first + (2 * k + 1) * FRAME_NS // (2 * args.parts), part) for k, part in enumerate(sketches)]
        begin = perf_counter()
        deskewer(parts, trajectory, first + FRAME_NS // 2, range_m)
        moved_ms.append(1e3 * (perf_counter() - begin))
    yield {"size": f"{side}x{side}", "m": len(frequencies), "parts": args.parts, "move_ms": _times(moved_ms[WARM_UP:])}


def _sketch(rng: np.random.Generator, sensor: SensorModel, frequencies: tuple[int, ...]) -> Sketch:
    photons = 1 + rng.poisson(3, (sensor.rows, sensor.cols)).astype(np.uint32)
    turns = rng.random((*photons.shape, len(frequencies)))
    sums = (photons[..., None] * np.exp(2j * np.pi * turns)).astype(np.complex64)
    return Sketch(frequencies, sums, photons, sensor=sensor)


def _times(ms: list[float]) -> dict:
    return {name: round(float(np.percentile(ms, share)), 2) for name, share in (("least", 0), ("p50", 50), ("p95", 95))}
