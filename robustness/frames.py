"""Reconstruct frames and sensors that nobody should have, by every method: do all clouds hold numbers?

Each round draws a sensor (array, T, IRF, calibration, lens, timing), a frame (photons, or a sketch as a broken sender
might make it), a method and its options. A round holds if the sensor or the frame is refused in one line, or if the
cloud is finite and in its range, and no step divided by 0 or ran over. A round depends on the seed and its own number
alone: `--first 1234 --rounds 1` repeats one.
"""

import argparse
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from srt3d_ros.core.background import BACKGROUNDS
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.weighting import WEIGHTINGS
from srt3d_ros.errors import InvalidInput

ROUNDS = 20_000
MAX_SHOWN = 20          # failures that the summary holds in full
PHOTONS = 20_000        # of a frame, at most about so many
FULL = 2**32 - 1        # photons that a pixel of a sketch can have

ARRAYS = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (1, 3), (1, 33), (33, 1), (5, 7), (9, 33), (16, 16)]
PERIODS = [2, 3, 4, 5, 7, 8, 16, 33, 100, 256, 586, 1_000, 4_095, 4_613, 20_000, 65_535]
ODD = [0.0, -0.0, 1e-45, 1e-4, 1e-3, 0.5, 1.0, 2.0, 1e4, 1e6, 1e300, -1.0, np.nan, np.inf, -np.inf]


@dataclass
class Tally:
    rounds: int = 0
    clouds: int = 0
    points: int = 0
    refused: Counter = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)


def draw_sensor(rng: np.random.Generator) -> SensorModel:
    """A sensor with up to three odd properties; InvalidInput if it is refused."""
    rows, cols = ARRAYS[rng.integers(len(ARRAYS))]
    num_bins = PERIODS[rng.integers(len(PERIODS))]
    known = {"rows": rows, "cols": cols, "num_bins": num_bins, "bin_width_s": 10.0**rng.uniform(-12, -8),
             "irf": draw_irf(rng, num_bins)}
    odd = {
        "irf": lambda: np.stack([draw_irf(rng, num_bins, length=min(9, num_bins)) for _ in range(rows * cols)]),
        "irf_ref": lambda: int(rng.integers(-2, known["irf"].shape[-1] + 2)),
        "gain": lambda: odd_map(rng, np.ones((rows, cols))),
        "delay_bins": lambda: odd_map(rng, np.zeros((rows, cols))),
        "mask": lambda: rng.random((rows, cols)) > rng.choice([0, 0.1, 0.9, 1]),
        "background_shape": lambda: draw_irf(rng, num_bins, length=num_bins),
        "projection": lambda: draw_projection(rng, rows, cols),
        "bin_width_s": lambda: 10.0**rng.uniform(-21, 1),
        "toa_offset_bins": lambda: any_size(rng, 14),
        "range_offset_m": lambda: any_size(rng, 14),
    }
    for name in rng.choice(list(odd), rng.integers(0, 4), replace=False):
        known[name] = odd[name]()
    return SensorModel(**known)


def any_size(rng: np.random.Generator, digits: float, shape=None):
    """Numbers of every size up to so many digits, of both signs."""
    return rng.normal(size=shape) * 10.0**rng.uniform(-3, digits, shape)


def odd_map(rng: np.random.Generator, usual: np.ndarray) -> np.ndarray:
    """A map with one odd pixel, all odd, or of numbers of every size."""
    odd = ODD[rng.integers(len(ODD))]
    one_odd = usual.copy()
    one_odd.flat[rng.integers(usual.size)] = odd
    return [one_odd, np.full_like(usual, odd), np.abs(any_size(rng, 4, usual.shape)), usual][rng.integers(4)]


def draw_irf(rng: np.random.Generator, num_bins: int, length: int | None = None) -> np.ndarray:
    """An IRF of some shape, length and scale."""
    length = length or int(min(rng.choice([1, 2, 3, 20, 200, num_bins]), num_bins + (rng.random() < 0.02)))
    x = np.arange(length)
    shapes = [np.eye(1, length, rng.integers(length))[0], np.ones(length), rng.random(length)**8,
              np.exp(-0.5 * ((x - length / 2) / max(length / 6, 0.1))**2), np.exp(-x / max(length / 5, 1)),
              np.zeros(length)]
    irf = shapes[rng.choice(6, p=[0.25, 0.15, 0.2, 0.2, 0.18, 0.02])]
    irf = irf * rng.choice([1, 1e-300, 1e-40, 1e30, 1e300], p=[0.7, 0.1, 0.1, 0.07, 0.03])
    return odd_map(rng, irf) if rng.random() < 0.03 else irf


def draw_projection(rng: np.random.Generator, rows: int, cols: int):
    """A lens or a scanner with numbers of every size."""
    if rng.random() < 0.3:
        return AngularScan(*any_size(rng, 6, 4))
    focal = max(rows, cols) * abs(any_size(rng, rng.choice([2, 300])))
    bend = any_size(rng, 3, 5) if rng.random() < 0.5 else np.zeros(5)
    return Pinhole(focal, focal * 10.0**rng.uniform(-1, 1), *any_size(rng, rng.choice([3, 3, 300]), 2), PlumbBob(*bend))


def draw_events(rng: np.random.Generator, sensor: SensorModel) -> PhotonEvents:
    """Photons of an odd frame."""
    pixels, num_bins = sensor.pixels, sensor.num_bins
    count = int(rng.choice([0, 1, 2, pixels, 10 * pixels, PHOTONS]))
    pixel = [rng.integers(0, pixels, count), np.full(count, rng.integers(pixels)), np.arange(count) % pixels,
             np.where(rng.random(count) < 0.9, 0, pixels - 1)][rng.integers(4)].astype(np.uint32)
    spread = rng.integers(0, rng.choice([1, 2, min(9, num_bins), num_bins]), count)
    toa = (rng.choice([0, num_bins - 1, num_bins // 2]) + spread) % num_bins
    if rng.random() < 0.3:
        last = np.nextafter(np.float32(num_bins), np.float32(0))
        return PhotonEvents(pixel, np.minimum(toa + rng.random(count), last).astype(np.float32).clip(0, last))
    return PhotonEvents(pixel, toa.astype(rng.choice([np.uint16, np.uint32])))


def draw_sketch(rng: np.random.Generator, sensor: SensorModel, frequencies: tuple[int, ...]) -> Sketch:
    """A sketch that no photons have: garbage, as a broken sender might make it."""
    shape, m = (sensor.rows, sensor.cols), len(frequencies)
    photons = [np.zeros(shape), np.ones(shape), np.full(shape, FULL), rng.integers(0, 2**32, shape),
               rng.poisson(5, shape)][rng.integers(5)].astype(np.uint32)
    # as of one surface, or of none
    toa = rng.uniform(0, sensor.num_bins, (*shape, rng.choice([1, m])))
    sums = np.exp(2j * np.pi / sensor.num_bins * np.array(frequencies) * toa)
    sums *= rng.choice([0, 1e-30, 0.01, 0.5, 1, 1, 1, 1.001, 10])
    with np.errstate(over="ignore", under="ignore"):
        sums = (sums * np.maximum(photons, rng.integers(2))[..., None]).astype(np.complex64)
    if rng.random() < 0.1:
        sums.flat[rng.integers(sums.size)] = rng.choice([np.nan, np.inf, -np.inf, 1j * np.inf, 1e38, 1e20])
    return Sketch(frequencies, sums, photons)


def draw_options(rng: np.random.Generator, name: str) -> dict:
    """Options that the method has."""
    every = {"false_alarm_rate": lambda: float(rng.choice([1e-12, 1e-4, 0.3, 0.999])),
             "background": lambda: str(rng.choice(BACKGROUNDS)), "weighting": lambda: str(rng.choice(WEIGHTINGS)),
             "warm_start": lambda: bool(rng.random() < 0.5), "upsampling": lambda: int(rng.integers(1, 4))}
    chosen = {option: every[option]() for option in METHODS[name].options if rng.random() < 0.5}
    return {"surfaces": int(rng.integers(1, 5)), "device": "cpu", **chosen}


def draw_frequencies(rng: np.random.Generator, name: str, sensor: SensorModel) -> tuple[int, ...]:
    """Frequencies by rule, with a size that may be too large, or from a list that may be useless."""
    if rng.random() < 0.1:
        return choose(",".join(map(str, rng.integers(-1, sensor.num_bins, rng.integers(1, 5)))), sensor)
    size = None if rng.random() < 0.6 else int(rng.choice([1, 2, 3, 20, 64, 65]))
    return choose(METHODS[name].frequencies if rng.random() < 0.7 else "spread", sensor, size)


def play(rng: np.random.Generator, tally: Tally) -> list[str]:
    """One round; returns what is wrong."""
    try:
        sensor, name = draw_sensor(rng), str(rng.choice(list(METHODS)))
        method, options = METHODS[name], draw_options(rng, name)
        frequencies = draw_frequencies(rng, name, sensor) if method.needs == "sketch" else None
        reconstruct = method.build(sensor, frequencies, **options)
        wrong = []
        for _ in range(1 + 2 * options.get("warm_start", False)):
            frame = draw_events(rng, sensor)
            if method.needs == "sketch":
                frame = (draw_sketch(rng, sensor, frequencies) if rng.random() < 0.5
                         else sketch_photons(frame, sensor, frequencies))
            cloud = reconstruct(frame)
            tally.clouds += 1
            tally.points += len(cloud)
            finer = reconstruct.sensor if hasattr(reconstruct, "sensor") else sensor
            wrong += [f"{name} {options}: {line}" for line in faults(cloud, finer)]
        return wrong
    except InvalidInput as refusal:
        tally.refused[refusal.field] += 1
        return [] if len(str(refusal).splitlines()) == 1 else [f"a refusal of several lines: {refusal}"]


def faults(cloud: PointCloud, sensor: SensorModel) -> list[str]:
    """What no consumer of the cloud could use."""
    found = [f"{name} is not finite" for name in ("depth_bins", "intensity", "depth_std_bins", "xyz", "background")
             if not np.isfinite(getattr(cloud, name)).all()]
    for name, good in (("depth_bins", (cloud.depth_bins >= 0) & (cloud.depth_bins < sensor.num_bins)),
                       ("intensity", cloud.intensity > 0), ("depth_std_bins", cloud.depth_std_bins > 0),
                       ("background", cloud.background >= 0), ("row", cloud.row < sensor.rows),
                       ("col", cloud.col < sensor.cols)):
        if not good.all():
            found.append(f"{name} out of its range: {getattr(cloud, name)[~good][:3]}")
    for image in (cloud.image("intensity"), cloud.depth_image(sensor.projection)):
        if np.isinf(image).any() or np.isfinite(image).sum() != (cloud.surface == 0).sum():
            found.append("an image with other pixels than the cloud")
    if sensor.mask is not None and not sensor.mask[cloud.row, cloud.col].all():
        found.append("a point in a masked pixel")
    return found


def play_all(rounds, seed: int, end_s: float = float("inf")) -> Tally:
    """All rounds, or those before `end_s` of time.monotonic()."""
    tally = Tally()
    for number in rounds:
        if time.monotonic() > end_s:
            break
        tally.rounds += 1
        try:
            with np.errstate(divide="raise", over="raise", invalid="raise"):
                wrong = play(np.random.default_rng([seed, number]), tally)
        except Exception as failure:        # whatever it is, it is a finding
            wrong = [f"{type(failure).__name__}: {failure}"]
        tally.failures += [f"round {number}: {line}" for line in wrong]
    return tally


def run(args: argparse.Namespace) -> tuple[list, dict]:
    tally = play_all(tqdm(range(args.first, args.first + args.rounds), unit="round"), args.seed, args.end_s)
    seen = f"{tally.rounds} rounds, {tally.clouds} clouds, {tally.points} points, {tally.refused.total()} refused"
    verdicts = [("numbers or one line", not tally.failures, "; ".join([seen, *tally.failures[:MAX_SHOWN]]))]
    return verdicts, {"seed": args.seed, "rounds": tally.rounds, "clouds": tally.clouds, "points": tally.points,
                      "refused": dict(tally.refused.most_common()), "failures": len(tally.failures)}
