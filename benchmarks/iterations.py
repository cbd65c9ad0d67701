"""Quality and time against the number and the windows of `pooled`'s iterations: why they are as they are.

    python benchmarks/iterations.py [--repeats 5]

Prints a table in Markdown; docs/performance.md has it.
"""

import argparse
import time

import numpy as np
from tqdm import tqdm

from srt3d_ros.core import pooled
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.evaluation.machine import machine

LIGHT = ((10, 1), (1, 1), (1, 10), (0.1, 10), (1, 100))         # SBR, photons per pixel
DEFAULT = pooled.WINDOWS
VARIANTS = {
    "the first twice": DEFAULT[:1] * 2,
    "without the second": (DEFAULT[0], DEFAULT[2]),
    "default": DEFAULT,
    "the last twice": (*DEFAULT, DEFAULT[2]),
    "the last four times": (*DEFAULT, *DEFAULT[2:] * 3),
    "smaller windows: radius 3, 4, 5": tuple((sigma, radius) for (sigma, _), radius in zip(DEFAULT, (3, 4, 5))),
}
TOLERANCE_MM = 40


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each, in turns (%(default)s)")
    args = parser.parse_args()
    scenes = []
    for sbr, ppp in LIGHT:
        simulator = Simulator(sbr=sbr, ppp=ppp, seed=3)
        sensor, (frame, truth) = simulator.sensor, simulator.frame(0)
        frequencies = choose("auto", sensor, 10)
        scenes.append((sketch_photons(frame, sensor, frequencies), truth))
    tolerance = TOLERANCE_MM * 1e-3 / sensor.bin_width_m
    quality, seconds = {}, {name: [] for name in VARIANTS}
    reconstruct = pooled.Pooled(sensor, frequencies)
    reconstruct(scenes[0][0])                                   # compiles, and finds its memory
    for _ in tqdm(range(args.repeats), unit="round"):
        for name, windows in VARIANTS.items():
            pooled.WINDOWS = windows
            for scene, (sketch, truth) in enumerate(scenes):
                started = time.perf_counter()
                cloud = reconstruct(sketch)
                seconds[name].append(time.perf_counter() - started)
                quality[name, scene] = evaluate(cloud, truth, tolerance, sensor.num_bins)
    facts = machine()
    print(f"{facts['machine']}, {facts['cpus']} cores, load {facts['load_1min']}; TD % / FD % / DAE mm, "
          f"tolerance {TOLERANCE_MM} mm, {sensor.rows} × {sensor.cols}\n")
    print("| iterations | ms, median | " + " | ".join(f"SBR {sbr}, {ppp} ppp" for sbr, ppp in LIGHT) + " |")
    print("|---" * (len(LIGHT) + 2) + "|")
    for name in VARIANTS:
        found = [quality[name, scene] for scene in range(len(LIGHT))]
        print(f"| {name} | {1e3 * np.median(seconds[name]):.1f} | " + " | ".join(
            f"{100 * one.true_detections:.2f} / {100 * one.false_detections:.2f} / "
            f"{one.dae_bins * sensor.bin_width_m * 1e3:.2f}" for one in found) + " |")


if __name__ == "__main__":
    main()
