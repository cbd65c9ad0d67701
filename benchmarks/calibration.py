"""How often the depth error is within 1 σ (68 % expected) and 2 σ (95 %) of the `depth_std` of points.

Simulated planes, slopes and steps, square, with T = 1000, a Gaussian IRF of σ = 4 bins and m = 10. A point that is off
by more than three IRF σ is false and does not count. docs/RESULTS.md has the table.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import srt3d_ros
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator

NUM_BINS, IRF_SIGMA = 1000, 4.0
NEAR = 3 * IRF_SIGMA        # bins
DRAWS = {8: 200, 32: 40, 128: 4, 512: 1}        # frames by size: neighbours err alike, so small images need more
FEWEST = 50                 # points; shares of fewer are None
SHAPES = ("plane", "slope", "step")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--shapes", nargs="+", choices=SHAPES, default=SHAPES, help="scenes (all)")
    parser.add_argument("--sizes", type=int, nargs="+", choices=DRAWS, default=[*DRAWS], help="rows and columns (all)")
    parser.add_argument("--ppp", type=float, nargs="+", default=(1, 10, 100), help="photons per pixel")
    parser.add_argument("--sbr", type=float, nargs="+", default=(10, 1, 0.1), help="signal over background")
    parser.add_argument("--irf-sigma", type=float, default=IRF_SIGMA, help="σ of the IRF, bins (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each shape, size, SBR and number of photons."""
    for shape in args.shapes:
        for size in args.sizes:
            for sbr in args.sbr:
                for ppp in args.ppp:
                    yield {"shape": shape, "size": size, "sbr": sbr, "ppp": ppp} | within(
                        shape, size, ppp, sbr, args.irf_sigma, DRAWS[size])


def within(shape: str, size: int, ppp: float, sbr: float, irf_sigma: float, draws: int) -> dict:
    """Shares of points within 1 and 2 σ, %, RMS error, bins, and points per 100 pixels."""
    ratio, error = (np.concatenate(parts) for parts in zip(*(
        errors(shape, size, ppp, sbr, irf_sigma, seed) for seed in range(draws))))
    line = {"points_percent": round(100 * len(ratio) / (draws * size**2), 1)}
    if len(ratio) < FEWEST:
        return line | dict.fromkeys(("within_1_percent", "within_2_percent", "rmse_bins"))
    return line | {"within_1_percent": round(100 * (ratio <= 1).mean(), 1),
                   "within_2_percent": round(100 * (ratio <= 2).mean(), 1),
                   "rmse_bins": round(float(np.sqrt(np.square(error).mean())), 4)}


def errors(shape: str, size: int, ppp: float, sbr: float, irf_sigma: float,
           seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Depth errors of the true points of one frame: divided by the claimed standard deviation, and in bins."""
    reach, truth = max(int(6 * irf_sigma), 1), depth(shape, size)
    irf = np.exp(-np.arange(-reach, reach + 1)**2 / (2 * irf_sigma**2))
    sensor = srt3d_ros.Sensor(size, size, NUM_BINS, 1e-10, irf, projection=Pinhole.from_fov(size, size, 20.0))
    photons, _ = Simulator(StaticScene(sensor.range_m(truth)), sensor, sbr, ppp, seed).frame(0)
    cloud = srt3d_ros.reconstruct(photons, sensor=sensor, device="cpu")
    error = cloud.depth_bins - truth[cloud.row, cloud.col]
    found = np.abs(error) <= NEAR
    return (np.abs(error) / cloud.depth_std_bins)[found], error[found]


def depth(shape: str, size: int) -> np.ndarray:
    """Depth, bins, [size, size]: flat at 500.3; rising by 0.1 and 0.07 bins per pixel; or with a step of 60 bins."""
    down, right = np.mgrid[:size, :size] - size / 2
    return 500.3 + {"plane": 0 * right, "slope": 0.1 * right + 0.07 * down, "step": 60.0 * (right >= 0)}[shape]
