"""Whether what is claimed to be empty is: objects of the promised brightness, pile-up, and signs of life.

objects, pile_up: of the pixels of objects, those that claim emptiness behind them, %, with the object at random ranges
`inside` the claim or at its `end`. 64 × 64 pixels with b background photons; pile_up: first photons of cycles.
life: of the pixels of an area, those known to work, %, k frames of 0.1 s after something happens (0: the first).
"""

import argparse
from collections.abc import Iterator

import numpy as np

from srt3d_ros.core.free_space import FreeSpace
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.signs_of_life import SignsOfLife
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.simulation.simulator import first_of_cycle

SIDE = 64
SHAPES = {"3x3": (3, 3), "2x5": (2, 5), "5x5": (5, 5), "pole": (30, 1), "15x15": (15, 15)}
SENSORS = ((150, 1.5, 5), (150, 4, 10), (4613, 4, 5), (4613, 4, 10), (4613, 20, 10))        # T, σ of the IRF, m
SCENES = [{"num_bins": t, "sigma": sigma, "m": m} for t, sigma, m in SENSORS] + [
    {"gradient": 10}, {"gradient": 1000}, {"bright": 20}, {"bright": 200}, {"wall": 0.3}, {"wall": 1}, {"wall": 5},
    {"wall": 30}, {"surfaces": 2}, {"surfaces": 2, "wall": 5}, {"edge": True}, {"gain": True}, {"fog": 0.8}]
CASES = {"objects": [{"b": b, "shape": shape} for b in (0.01, 0.1, 1, 10, 30) for shape in SHAPES] + [
    {"b": b, "shape": shape} | scene for shape in ("3x3", "pole") for b in (0.1, 3) for scene in SCENES],
    "pile_up": [{"b": flux * cycles, "shape": shape, "cycles": cycles, "brightness": a} for cycles in (10, 100)
                for flux in (0.1, 0.5, 1, 2) for shape in ("5x5", "pole") for a in (100, 400)]}
BLOCK, STRIP = np.zeros((2, SIDE, SIDE), bool)
BLOCK[24:32, 40:48] = STRIP[:, 20:23] = True
EVERYWHERE = np.ones_like(BLOCK)
# What happens, where, the share of photons there before and after, and whether points go with it.
EVENTS = (("alive", EVERYWHERE, 1, 1, False), ("dead from the start", BLOCK, 0, 0, False), ("dies", BLOCK, 1, 0, False),
          ("three columns die", STRIP, 1, 0, False), ("dies before a wall", BLOCK, 1, 0, True), ("an object leaves",
           BLOCK, 1, 1, True), ("30 % light", EVERYWHERE, 1, 0.3, False), ("covered", EVERYWHERE, 1, 0.03, False))
AFTER = {"before": -1} | {f"+{k}": k for k in (0, 1, 2, 5, 10, 30, 100)}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", nargs="*", default=(*CASES, "life"), metavar="PART", help="objects, pile_up, life")
    parser.add_argument("--objects", type=int, default=200, metavar="N", help="in a line (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    for part in args.parts:
        for case in CASES.get(part, ()):
            yield {"part": part} | case | {at: missed(args.objects, at == "end", **case) for at in ("inside", "end")}
        for b in (0.01, 0.03, 0.1, 1, 10) if part == "life" else ():
            yield from ({"part": part, "b": b, "event": event[0]} | known(b, *event[1:]) for event in EVENTS)


def missed(objects: int, at_end: bool, shape: str, b: float, num_bins: int = 1000, sigma: float = 4.0, m: int = 10,
           surfaces: int = 1, gradient: float = 1, wall: float = 0, bright: float = 0, fog: float = 0,
           edge: bool = False, gain: bool = False, cycles: int = 0, brightness: float = 1e-4) -> float:
    """Percent of the pixels of objects that claim emptiness behind them."""
    rng, size, x = np.random.default_rng(1), (SIDE, SIDE), np.arange(-int(4 * sigma), int(4 * sigma) + 1)
    maps = {"gain": np.exp(rng.normal(0, 0.35, size)), "mask": rng.random(size) > 0.05} if gain else {}
    decay = np.exp(-12 * np.arange(num_bins) / num_bins)
    spread = (1 - fog) / num_bins + fog * decay / decay.sum()
    sensor = SensorModel(*size, num_bins, 1e-10, np.exp(-x**2 / (2 * sigma**2)), cycles=cycles or None, **maps)
    frequencies = choose_frequencies("auto", sensor, m)
    pooled, free = Pooled(sensor, frequencies, surfaces), FreeSpace(sensor, frequencies)
    constants = Matcher(sensor, frequencies).constants
    behind_m = 3 * sensor.bin_width_m * np.sqrt(constants["total_energy"] / constants["curvature"])
    background = b * gradient**np.linspace(-0.5, 0.5, SIDE) * np.ones(size)
    claiming, pixels, frames = 0, 0, 4 if fog else 1        # in which the background is learned
    while objects > 0:
        areas = placed(rng, SHAPES[shape], edge)
        objects -= len(areas)
        r, range_m = np.full(size, float(wall)), np.full(size, float(sensor.range_m(0.9 * num_bins)))
        for area in areas if bright else ():        # a bright patch, 0 to 3 pixels to the right
            rows, cols = np.nonzero(area)
            right = cols.max() + 1 + rng.integers(4)
            r[max(rows.min() - 2, 0):rows.max() + 3, right:right + 8] = bright
        r[np.any(areas, axis=0)] = wall
        r[:, -20:] += 5 * (fog > 0)                 # a wall, without which fog is taken for a surface
        empty = drawn(rng, sensor, frequencies, background, spread, range_m, r, sigma)
        cloud = [pooled(empty) for _ in range(frames)][-1].within(max_m=-1)     # as if it had no points
        claim, light = free.range_m(empty, cloud, brightness), []
        for area in areas:
            r_min = brightness / np.nanmedian(claim[area])**2       # times SAFETY, and without pile-up
            at = sensor.range_m(rng.uniform(0.05, 0.8) * num_bins) if not cycles else np.nanmedian(claim[area])
            light.append(brightness if cycles else at**2 * r_min * (1 if at_end else rng.uniform(1, 4)))
            range_m[area] = at * rng.uniform(0.6, 1) if cycles and not at_end else at
            r[area] = light[-1] / range_m[area]**2
        seen = drawn(rng, sensor, frequencies, background, spread, range_m, r, sigma)
        cloud = pooled(seen)
        for area, a in zip(areas, light):           # at the end, only points near it may keep a pixel from claiming
            claim = free.range_m(seen, cloud, a if cycles or not at_end else 1e6 * a)
            claiming, pixels = claiming + (claim > range_m + behind_m)[area].sum(), pixels + sensor.used[area].sum()
    return round(100 * float(claiming / pixels), 2)


def placed(rng: np.random.Generator, shape: tuple[int, int], edge: bool) -> list[np.ndarray]:
    """Areas of objects, 9 pixels apart, upright or lying, anywhere or at an edge of the image; bool [rows, cols]."""
    areas, taken = [], np.zeros((SIDE, SIDE), bool)
    for _ in range(60):
        height, width = shape if rng.random() < 0.5 else shape[::-1]
        top, left = rng.integers(0, SIDE - height + 1), rng.integers(0, SIDE - width + 1)
        if edge:
            top, left = ((0, left), (SIDE - height, left), (top, 0), (top, SIDE - width))[rng.integers(4)]
        if len(areas) < 8 and not taken[max(top - 9, 0):top + height + 9, max(left - 9, 0):left + width + 9].any():
            taken[top:top + height, left:left + width] = True
            areas.append(np.zeros_like(taken))
            areas[-1][top:top + height, left:left + width] = True
    return areas


def drawn(rng: np.random.Generator, sensor: SensorModel, frequencies: tuple[int, ...], background: np.ndarray,
          spread: np.ndarray, range_m: np.ndarray, r: np.ndarray, sigma: float) -> PhaseSums:
    """The sketch of one surface in each pixel, r a pixel at exposure 1, and of the background."""
    stray, signal = (rng.poisson(light * sensor.exposure).ravel() for light in (background, r))
    pixel = np.repeat(np.tile(np.arange(sensor.pixels, dtype=np.uint32), 2), np.r_[stray, signal])
    depth = np.repeat(sensor.depth_bins(range_m).ravel(), signal)
    toa = np.r_[rng.choice(sensor.num_bins, stray.sum(), p=spread), np.rint(rng.normal(depth, sigma)) % sensor.num_bins]
    order = np.argsort(pixel, kind="stable")
    photons = pixel[order], toa[order].astype(np.uint16)
    photons = first_of_cycle(*photons, sensor.cycles, rng) if sensor.cycles else photons
    return sketch_photons(PhotonEvents(*photons), sensor, frequencies)


def known(b: float, area: np.ndarray, before: float, after: float, with_points: bool) -> dict[str, float]:
    """Percent of an area's pixels that are known to work, before an event in frame 60 and after it."""
    rng, life, out = np.random.default_rng(3), SignsOfLife(EVERYWHERE), {}
    for k in range(161):
        has_point = area & (with_points and k < 60)
        mean = np.where(area, b * (before if k < 60 else after), b) + 30 * has_point
        out[k - 60] = life((k + 1) * 100_000_000, rng.poisson(mean), has_point, -1)[area].mean()
    return {name: round(100 * float(out[k]), 1) for name, k in AFTER.items()}
