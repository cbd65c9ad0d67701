"""How often the depth error is within 1 σ (68 % expected) and 2 σ (95 %) of the `depth_std` of points.

Square scenes with T = 1000, a Gaussian IRF of σ = 4 bins and m = 10, by photons drawn here, not by the simulator. A
point that is off by more than three IRF σ is false and does not count. rms/std, the RMS of error / std, should be 1.
docs/RESULTS.md has the table.
"""

import argparse
from collections.abc import Iterator
from itertools import product

import numpy as np

import srt3d_ros
from srt3d_ros.core.sensor.projection import Pinhole

NUM_BINS, IRF_SIGMA = 1000, 4.0
NEAR = 3 * IRF_SIGMA        # bins
DRAWS = {32: 40, 128: 4}    # frames by size: neighbours err alike, so small images need more
SHAPES = ("plane", "slope", "step", "relief", "bumps", "offsets", "texture", "steep")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--shapes", nargs="+", choices=SHAPES, default=SHAPES, help="scenes (all)")
    parser.add_argument("--sizes", type=int, nargs="+", choices=DRAWS, default=[*DRAWS], help="rows and columns (all)")
    parser.add_argument("--ppp", type=float, nargs="+", default=(1, 10, 100), help="photons per pixel")
    parser.add_argument("--sbr", type=float, nargs="+", default=(10, 1, 0.1), help="signal over background")
    parser.add_argument("--irf-sigma", type=float, default=IRF_SIGMA, help="σ of the IRF, bins (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each shape, size, SBR and number of photons: shares of points, %, rms/std and RMS error, bins."""
    for shape, size, sbr, ppp in product(args.shapes, args.sizes, args.sbr, args.ppp):
        ratio, error = np.hstack([errors(shape, size, ppp, sbr, args.irf_sigma, seed) for seed in range(DRAWS[size])])
        rms, rmse = np.sqrt(np.square([ratio, error]).mean(axis=1))
        yield {"shape": shape, "size": size, "sbr": sbr, "ppp": ppp,
               "points_percent": round(100 * len(ratio) / (DRAWS[size] * size**2), 1),
               "within_1_percent": round(100 * float((ratio <= 1).mean()), 1),
               "within_2_percent": round(100 * float((ratio <= 2).mean()), 1),
               "rms_over_std": round(float(rms), 2), "rmse_bins": round(float(rmse), 4)}


def errors(shape: str, size: int, ppp: float, sbr: float, irf_sigma: float, seed: int) -> np.ndarray:
    """Depth errors of the true points of one frame, [2, N]: over the claimed standard deviation, and in bins."""
    reach, rng, pixels = max(int(6 * irf_sigma), 1), np.random.default_rng(seed), np.arange(size**2)
    truth, seen, light = scene(shape, size, rng)
    irf = np.exp(-np.arange(-reach, reach + 1)**2 / (2 * irf_sigma**2))
    signal = np.repeat(pixels, rng.poisson(ppp * sbr / (1 + sbr) * light.ravel()))
    noise = np.repeat(pixels, rng.poisson(ppp / (1 + sbr), size**2))
    toa = np.r_[np.rint(seen.ravel()[signal] + irf_sigma * rng.standard_normal(len(signal))) % NUM_BINS,
                rng.integers(0, NUM_BINS, len(noise))].astype(int)
    pixel = np.r_[signal, noise]
    sensor = srt3d_ros.Sensor(size, size, NUM_BINS, 1e-10, irf, projection=Pinhole.from_fov(size, size, 20.0))
    photons = srt3d_ros.from_events(pixel // size, pixel % size, toa, sensor=sensor)
    cloud = photons.sketch(sketch_size=10).reconstruct(device="cpu")
    error = cloud.depth_bins - truth[cloud.row, cloud.col]
    found = np.abs(error) <= NEAR
    return np.stack([np.abs(error) / cloud.depth_std_bins, error])[:, found]


def scene(shape: str, size: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True depths, the depths that the pixels see, bins, and relative light, [size, size] each.

    A plane; slopes of 0.12 and 4 bins per pixel; a step of 60 bins; relief of 2 bins, white; bumps of 3 bins
    every 6 pixels; uncalibrated delays of 1 bin; tiles of 4 pixels, of which half have a quarter of the light.
    """
    row, col = np.mgrid[:size, :size]
    down, right, flat = row - size / 2, col - size / 2, np.zeros((size, size))
    white = rng.standard_normal((size, size))
    ups = {"slope": 0.1 * right + 0.07 * down, "step": 60.0 * (right >= 0), "steep": 4.0 * right, "relief": 2 * white,
           "bumps": 3 * np.sin(np.pi * row / 3) * np.sin(np.pi * col / 3)}
    truth, tiles = 500.3 + ups.get(shape, flat), (row // 4 + col // 4) % 2
    light = np.where(tiles == 1, 1.6, 0.4) if shape == "texture" else flat + 1
    return truth, truth + white * (shape == "offsets"), light
