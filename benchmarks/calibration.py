"""How often the depth error is within 1 σ (68 % expected) and 2 σ (95 %) of the `depth_std` of points.

Planes, slopes and steps of squares of pixels, which this file simulates itself, independently of the package: T = 1000,
a Gaussian IRF of σ = 4 bins, m = 10. A point that is off by more than three IRF σ is false and does not count.
docs/evaluation.md has the table.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import srt3d_ros

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
    rng, truth = np.random.default_rng(seed), depth(shape, size)
    reach = max(int(6 * irf_sigma), 1)
    irf = np.exp(-np.arange(-reach, reach + 1)**2 / (2 * irf_sigma**2))
    row, col, toa = photons(truth, ppp * sbr / (1 + sbr), ppp / (1 + sbr), irf / irf.sum(), rng)
    cloud = srt3d_ros.from_events(
        row, col, toa, rows=size, cols=size, num_bins=NUM_BINS, bin_width_s=1e-10, irf=irf, irf_ref=reach,
        fov_deg=20.0).reconstruct(device="cpu")
    error = cloud.depth_bins - truth[cloud.row, cloud.col]
    found = np.abs(error) <= NEAR
    return (np.abs(error) / cloud.depth_std_bins)[found], error[found]


def depth(shape: str, size: int) -> np.ndarray:
    """Depth, bins, [size, size]: flat at 500.3; rising by 0.1 and 0.07 bins per pixel; or with a step of 60 bins."""
    down, right = np.mgrid[:size, :size] - size / 2
    return 500.3 + {"plane": 0 * right, "slope": 0.1 * right + 0.07 * down, "step": 60.0 * (right >= 0)}[shape]


def photons(truth: np.ndarray, signal: float, background: float, irf: np.ndarray,
            rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Row, col and bin of Poisson photons; the IRF is interpolated linearly between bins."""
    pixel = np.repeat(np.arange(truth.size), rng.poisson(signal, truth.size))
    late = truth.ravel()[pixel] + rng.choice(len(irf), len(pixel), p=irf) - len(irf) // 2
    seen = np.floor(late + rng.random(len(late))).astype(np.int64)
    even = np.repeat(np.arange(truth.size), rng.poisson(background, truth.size))
    pixel, toa = np.append(pixel, even), np.append(seen, rng.integers(0, NUM_BINS, len(even)))
    return pixel // truth.shape[1], pixel % truth.shape[1], toa % NUM_BINS
