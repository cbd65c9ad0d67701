"""Depth and intensity with pile-up (only the first photon of a laser cycle is recorded), corrected and not.

64 × 64 pixels, T = 1000, a Gaussian IRF with σ = 4 bins, 100 photons per pixel (ppp) without pile-up; two slanted walls
and a bowl, even or in a pattern of bright and dark tiles. Flux: photons per pixel and cycle. A line has the depth error
(DAE) and bias, bins, of points within 10 bins of the truth; intensity over the truth; true and false detections and
points within one standard deviation, %. Means over the seeds.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import srt3d_ros
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator

SIDE, PPP, TOLERANCE_BINS = 64, 100, 10
IRF = np.exp(-0.5 * (np.arange(-24, 25) / 4.0)**2)
SENSOR = srt3d_ros.Sensor(SIDE, SIDE, 1000, 1e-10, IRF, projection=Pinhole.from_fov(SIDE, SIDE, 10.0))
CASES = ((1.0, 0.3, False), (1.0, 1.0, False), (1.0, 2.0, False), (0.1, 1.0, False), (0.1, 2.0, True))


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="draws of each case (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """Lines for each SBR and flux: as recorded, corrected, and without pile-up."""
    row, col = np.mgrid[:SIDE, :SIDE] // 8
    bright_and_dark = 0.4 + 1.2 * ((row + col) % 2)         # relative light, signal and background
    for sbr, flux, tiles in CASES:
        cycles, ideal = round(PPP / flux), SENSOR.replace(gain=bright_and_dark if tiles else None)
        real = ideal.replace(cycles=cycles)
        ways = {"not corrected": (real, None), "corrected": (real, cycles), "no pile-up": (ideal, None)}
        for way, (seen, known) in ways.items():
            rows = []
            for seed in range(args.seeds):
                simulator = Simulator(StaticScene(SENSOR.range_m(depth_bins())), seen, sbr, PPP, seed)
                cloud = srt3d_ros.reconstruct(simulator.frame(0)[0], sensor=SENSOR, cycles=known)
                rows.append(judged(cloud, simulator.expected(0)[1][0]))
            means = {name: round(float(np.mean([row[name] for row in rows])), 3) for name in rows[0]}
            yield {"sbr": sbr, "flux": flux, "tiles": tiles, "way": way, "seeds": args.seeds} | means


def depth_bins() -> np.ndarray:
    """Two walls with a bowl between them, [rows, cols]."""
    row, col = np.mgrid[:SIDE, :SIDE]
    from_middle = (row - 32)**2 + (col - 32)**2
    walls = np.where(col < SIDE // 2, 250.3 + 2 * row, 620.7 + 1.5 * row)
    return np.where(from_middle < 18**2, 430.2 + 0.05 * from_middle, walls)


def judged(cloud: srt3d_ros.Cloud, signal: np.ndarray) -> dict:
    """The scores of a cloud; `signal` is the expected photons of each pixel's surface."""
    error = cloud.depth_bins - depth_bins()[cloud.row, cloud.col]
    near = np.abs(error) <= TOLERANCE_BINS
    return {"dae_bins": np.abs(error[near]).mean(), "bias_bins": error[near].mean(),
            "intensity": cloud.intensity[near].mean() / signal[cloud.row, cloud.col][near].mean(),
            "td_percent": 100 * near.sum() / SENSOR.pixels, "fd_percent": 100 * (~near).sum() / SENSOR.pixels,
            "within_1_std_percent": 100 * (np.abs(error) <= cloud.depth_std_bins).mean()}
