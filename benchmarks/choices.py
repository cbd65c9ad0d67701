"""Scores of `pooled` with and without a gate, and with the background assumed flat, known or learned.

--photons names a folder of photon files with references (docs/photon-file.md). Without it, only simulated scenes are
judged. A line has the true and false detections (TD, FD; %) and the depth error (DAE, bins), means over the draws.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.frames import mean_scores
from srt3d_ros.core import metrics
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import Photons, read
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.evaluation.cases import simulated

# With the gate: (file, τ in bins, surfaces) and (scene, SBR, photons per pixel, draws, surfaces).
GATE_FILES = (("art_real_unif_ppp5_sbr0.1", 10, 1), ("bowling_72x88_2_100", 3, 1), ("room_64_10_50", 3, 1))
GATE_SCENES = (("bust", 0.1, 10, 1, 1), ("net", 1.0, 10, 12, 2))
TIME = np.arange(4613) / 4613
SHAPES = {"flat": np.ones(4613), "ramp": 1 + 19 * TIME, "exp": np.exp(-20 * TIME) + 0.02,
          "fog": 30 * TIME * np.exp(-10 * TIME) + 0.1}
Judge = Callable[[Cloud, float], metrics.Metrics]     # of a cloud whose bin 0 is so many bins later


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photons", type=Path, metavar="DIR", help="folder of photon files with references")


def run(args: argparse.Namespace) -> Iterator[dict]:
    yield from gates(args.photons)
    yield from backgrounds()


def gates(folder: Path | None) -> Iterator[dict]:
    """Scores without a gate, and with the gate that `auto` finds in the histogram of all photons."""
    for data, draws in observed(folder, GATE_FILES, GATE_SCENES):
        for gate in ("off", "auto"):
            found = []
            for photons, surfaces, judge in draws:
                cloud = photons.reconstruct(gate=gate, surfaces=surfaces)
                found.append(judge(cloud, cloud.sensor.toa_offset_bins - photons.sensor.toa_offset_bins))
            yield {"data": data, "gate": gate, "draws": len(found)} | mean_scores(found)


def backgrounds() -> Iterator[dict]:
    """Scores where an uneven background is assumed flat, known from a dark frame, or learned."""
    plain = Simulator().sensor
    for shape, sbr in ((shape, sbr) for shape in SHAPES for sbr in (0.1, 1)):
        known = plain.replace(background_shape=SHAPES[shape])
        events, truth = Simulator(sensor=known, sbr=sbr, ppp=10, seed=1).frame(0)
        judge = judging(truth, 0.04 / plain.bin_width_m, plain, True)
        for way, sensor in (("flat", plain), ("sensor", known), ("auto", plain)):
            cloud = Photons(sensor, events).reconstruct(background=way)
            yield {"data": f"bust, {shape}, SBR {sbr:g}", "background": way} | mean_scores([judge(cloud, 0)])


def observed(folder: Path | None, files, scenes) -> Iterator[tuple[str, list[tuple[Photons, int, Judge]]]]:
    """The name of each data set, and of each draw: its photons, surfaces per pixel, and the judge of its clouds."""
    for name, tolerance, surfaces in files if folder else ():
        photons = read(folder / f"{name}.npz")
        yield name, [(photons, surfaces, judging(photons.reference_depth_bins, tolerance, photons.sensor, False))]
    for scene, sbr, ppp, draws, surfaces in scenes:
        cases = [(case, case.observe()) for case in simulated(scene, [sbr], [ppp], draws)]
        yield f"{scene}, SBR {sbr:g}, {ppp} ppp", [
            (Photons(case.sensor, seen.frame), surfaces,
             judging(seen.depth_bins, case.tolerance_bins, case.sensor, True)) for case, seen in cases]


def judging(truth: np.ndarray, tolerance: float, sensor: SensorModel, complete: bool) -> Judge:
    """A function that compares clouds with these depths [S, rows, cols]; see metrics.evaluate."""
    return lambda cloud, late: metrics.evaluate(cloud, truth - late, tolerance, sensor.num_bins, complete=complete)
