"""What pile-up costs, and what its correction gives back: detectors that record the first photon of each laser cycle.

64 × 64 pixels, T = 1000, a Gaussian IRF with σ = 4 bins, 100 photons per pixel (ppp) without pile-up; two slanted walls
and a bowl, even or in a pattern of bright and dark tiles. Flux: photons per pixel and cycle. Per line: depth error
(DAE) and bias, bins, of points within 10 bins of the truth; intensity over the truth; true and false detections and
points within one standard deviation, %. Means over the seeds.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import srt3d_ros

ROWS, COLS, BINS, PPP, TOLERANCE = 64, 64, 1000, 100, 10
IRF = np.exp(-0.5 * (np.arange(-24, 25) / 4.0)**2)
CASES = ((1.0, 0.3, False), (1.0, 1.0, False), (1.0, 2.0, False), (0.1, 1.0, False), (0.1, 2.0, True))


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="draws of each row (default 2)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """Lines for each SBR and flux: as recorded, corrected, and without pile-up."""
    for sbr, flux, tiles in CASES:
        found = {"not corrected": [], "corrected": [], "no pile-up": []}
        for seed in range(args.seeds):
            cycles = round(PPP / flux)
            first, every, depth, signal = simulate(sbr, flux, tiles, cycles, seed)
            for way, counts, known in (("not corrected", first, None), ("corrected", first, cycles),
                                       ("no pile-up", every, None)):
                cloud = srt3d_ros.reconstruct(counts, irf=IRF, bin_width_s=1e-10, fov_deg=10, cycles=known)
                found[way].append(judged(cloud, depth, signal))
        for way, rows in found.items():
            means = {name: round(float(np.mean([row[name] for row in rows])), 3) for name in rows[0]}
            yield {"sbr": sbr, "flux": flux, "tiles": tiles, "way": way, "seeds": args.seeds} | means


def simulate(sbr: float, flux: float, tiles: bool, cycles: int, seed: int) -> tuple[np.ndarray, ...]:
    """Counts [rows, cols, T] of the first photon of each cycle, and of every photon; depths and signal photons.

    A bin with the flux λ holds the first photon of a cycle with probability (1 − exp(−λ)) exp(−flux before it).
    """
    random = np.random.default_rng(seed)
    depth, light = scene(tiles)
    signal, background = light * flux * sbr / (1 + sbr), light * flux / (1 + sbr)
    rate = signal[..., None] * pulses(depth) + background[..., None] / BINS
    first = -np.expm1(-rate) * np.exp(rate - np.cumsum(rate, axis=2))
    nothing = np.maximum(1 - first.sum(axis=2, keepdims=True), 0)
    seen = random.multinomial(cycles, np.concatenate([first, nothing], axis=2))[..., :BINS]
    return seen.astype(np.uint16), random.poisson(cycles * rate).astype(np.uint16), depth, cycles * signal


def scene(tiles: bool) -> tuple[np.ndarray, np.ndarray]:
    """Depths, bins, and relative light of every pixel, [rows, cols], of mean 1."""
    row, col = np.mgrid[:ROWS, :COLS]
    from_middle = (row - 32)**2 + (col - 32)**2
    walls = np.where(col < COLS // 2, 250.3 + 2 * row, 620.7 + 1.5 * row)
    light = 0.4 + 1.2 * ((row // 8 + col // 8) % 2) if tiles else np.ones((ROWS, COLS))
    return np.where(from_middle < 18**2, 430.2 + 0.05 * from_middle, walls), light / light.mean()


def pulses(depth: np.ndarray) -> np.ndarray:
    """The share of a return in each bin, [rows, cols, T]: the IRF, shifted by linear interpolation."""
    whole = np.floor(depth).astype(int)
    part, out = (depth - whole)[..., None], np.zeros((*depth.shape, BINS))
    bins = whole[..., None] + np.arange(len(IRF)) - len(IRF) // 2
    for late, share in ((0, 1 - part), (1, part)):
        moved = np.zeros_like(out)
        np.put_along_axis(moved, bins + late, share * IRF / IRF.sum(), axis=2)
        out += moved
    return out


def judged(cloud: srt3d_ros.Cloud, depth: np.ndarray, signal: np.ndarray) -> dict:
    """What a line says of a cloud of one surface a pixel."""
    error = cloud.depth_bins - depth[cloud.row, cloud.col]
    near = np.abs(error) <= TOLERANCE
    return {"dae_bins": np.abs(error[near]).mean(), "bias_bins": error[near].mean(),
            "intensity": cloud.intensity[near].mean() / signal[cloud.row, cloud.col][near].mean(),
            "td_percent": 100 * near.sum() / depth.size, "fd_percent": 100 * (~near).sum() / depth.size,
            "within_1_std_percent": 100 * (np.abs(error) <= cloud.depth_std_bins).mean()}
