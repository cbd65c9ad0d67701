"""What two choices change: a gate around the scene, and the background that is assumed.

--photons names a folder of photon files with references (docs/photon-file.md); without it, only simulated scenes are
judged. Lines: true detections (TD), false detections (FD), %, and depth error (DAE), bins, means over the draws.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core import metrics
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import Photons, read
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.evaluation.cases import simulated

# Of the gate: file, τ in bins, surfaces; and scene, SBR, photons a pixel, draws, surfaces.
GATE_FILES = (("art_real_unif_ppp5_sbr0.1", 10, 1), ("bowling_72x88_2_100", 3, 1), ("room_64_10_50", 3, 1))
GATE_SCENES = (("bust", 0.1, 10, 1, 1), ("net", 1.0, 10, 12, 2))
TIME = np.arange(4613) / 4613
SHAPES = {"flat": np.ones(4613), "ramp": 1 + 19 * TIME, "exp": np.exp(-20 * TIME) + 0.02,
          "fog": 30 * TIME * np.exp(-10 * TIME) + 0.1}
Judge = Callable[[Cloud, float], metrics.Metrics]     # a cloud, and the bins by which its bin 0 is later


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photons", type=Path, metavar="DIR", help="photon files")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each data, choice and way."""
    yield from gates(args.photons)
    yield from backgrounds()


def gates(folder: Path | None) -> Iterator[dict]:
    """Without a gate, and with one around what the photons' histogram shows."""
    for data, draws in observed(folder, GATE_FILES, GATE_SCENES):
        for gate in ("off", "auto"):
            found = []
            for photons, surfaces, judge in draws:
                cloud = photons.reconstruct(gate=gate, surfaces=surfaces)
                found.append(judge(cloud, cloud.sensor.toa_offset_bins - photons.sensor.toa_offset_bins))
            yield line(data, "gate", gate, found)


def backgrounds() -> Iterator[dict]:
    """An uneven background that is taken for even, known from a dark frame, or learned."""
    plain = Simulator().sensor
    for shape, sbr in ((shape, sbr) for shape in SHAPES for sbr in (0.1, 1)):
        known = plain.replace(background_shape=SHAPES[shape])
        events, truth = Simulator(sensor=known, sbr=sbr, ppp=10, seed=1).frame(0)
        judge = judging(truth, 0.04 / plain.bin_width_m, plain, True)
        for way, sensor in (("flat", plain), ("sensor", known), ("auto", plain)):
            cloud = Photons(sensor, events).reconstruct(background=way)
            yield line(f"bust, {shape}, SBR {sbr:g}", "background", way, [judge(cloud, 0)])


def observed(folder: Path | None, files, scenes) -> Iterator[tuple[str, list[tuple[Photons, int, Judge]]]]:
    """Names, and of each draw the photons, their surfaces, and what judges a cloud of them."""
    for name, tolerance, surfaces in files if folder else ():
        photons = read(folder / f"{name}.npz")
        yield name, [(photons, surfaces, judging(photons.reference_depth_bins, tolerance, photons.sensor, False))]
    for scene, sbr, ppp, draws, surfaces in scenes:
        cases = [(case, case.observe()) for case in simulated(scene, [sbr], [ppp], draws)]
        yield f"{scene}, SBR {sbr:g}, {ppp} ppp", [
            (Photons(case.sensor, seen.frame), surfaces,
             judging(seen.depth_bins, case.tolerance_bins, case.sensor, True)) for case, seen in cases]


def judging(truth: np.ndarray, tolerance: float, sensor: SensorModel, complete: bool) -> Judge:
    """Compares clouds with these depths [S, rows, cols]; see metrics.evaluate."""
    return lambda cloud, late: metrics.evaluate(cloud, truth - late, tolerance, sensor.num_bins, complete=complete)


def line(data: str, choice: str, way: str, found: list[metrics.Metrics]) -> dict:
    """The means of what was found."""
    td, fd, dae = np.mean([(one.true_detections, one.false_detections, one.dae_bins) for one in found], axis=0)
    return {"data": data, choice: way, "draws": len(found), "td_percent": round(100 * td, 2),
            "fd_percent": round(100 * fd, 2), "dae_bins": round(dae, 3)}
