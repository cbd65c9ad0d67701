"""The cases of ablation.py: frames as sketches, and what judges their clouds.

Photon files by their names, and simulated scenes named like `bust_1_10`: SBR 1, 10 photons per pixel.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import held_out
import numpy as np
from tqdm import tqdm

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import NetScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.evaluation.cases import Case, Observation, of_files, simulated
from srt3d_ros.evaluation.run import judge
from srt3d_ros.evaluation.tolerance import Tolerance

SIMULATED = {f"{scene}_{sbr:g}_{ppp:g}": (scene, sbr, ppp, surfaces) for scene, sbr, ppp, surfaces in (
    ("bust", 10, 1, 1), ("bust", 1, 1, 1), ("bust", 1, 10, 1), ("bust", 0.1, 10, 1), ("bust", 1, 100, 1),
    ("net", 1, 10, 2))}                 # scene, SBR, photons per pixel, K; K of a file is its number of references
FRAMES = 3                              # of a simulated scene, which moves: the last is judged, warm_start sees all
SKETCH_SIZE = 10
TOLERANCE_BINS = {"room_64_*": 3, "*_72x88_*": 3, "mannequin_face_340": 40, "two_layer_100": 40, "*": 10}
ALIGNED = {"two_layer_100": (1,)}       # references, from 0, to be shifted by their median offset from the cloud


@dataclass(frozen=True)
class Trial:
    """Consecutive frames to reconstruct; the cloud of the last is judged.

    Args:
        case: sensor, K, tolerance.
        frames: makes the photons.
        observation: the reference.
        kept: of a case without a reference, photons (seen, kept) that judge the cloud.
    """

    case: Case
    frames: Callable[[], list[PhotonEvents]]
    observation: Observation
    kept: tuple[PhotonEvents, ...] = ()


def names_of(data: Path, patterns: list[str]) -> list[str]:
    """The cases whose name has one of the patterns."""
    every = [*sorted(file.stem for file in data.glob("*.npz")), *SIMULATED]
    return [name for name in every if any(fnmatch(name, pattern) for pattern in patterns)]


def open_trial(name: str, data: Path) -> Trial:
    return _simulated(*SIMULATED[name]) if name in SIMULATED else _of_file(data / f"{name}.npz")


def save_sketches(names: list[str], data: Path, folder: Path) -> None:
    """Sketch the frames of the cases, into a file for each."""
    for name in tqdm(names, unit="case", desc="sketching", leave=False):
        trial = open_trial(name, data)
        frequencies = choose("auto", trial.case.sensor, SKETCH_SIZE)
        sketches = [sketch_photons(frame, trial.case.sensor, frequencies) for frame in trial.frames()]
        np.savez(folder / f"{name}.npz", frequencies=frequencies, sums=[sketch.sums for sketch in sketches],
                 photons=[sketch.photons for sketch in sketches])


def load_sketches(name: str, folder: Path) -> list[Sketch]:
    with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
        frequencies = tuple(map(int, file["frequencies"]))
        return [Sketch(frequencies, *maps) for maps in zip(file["sums"], file["photons"])]


def reconstruct(trial: Trial, sketches: list[Sketch], options: dict, repeats: int) -> dict:
    """The columns of the results for one case: quality, CPU time of a frame (median of so many), number of points."""
    method = METHODS["pooled"].build(trial.case.sensor, sketches[-1].frequencies, surfaces=trial.case.surfaces,
                                     device="cpu", **options)
    before = sketches[:-1] if "warm_start" in options else []
    clouds, times = [], []
    for _ in range(1 + repeats):                    # the first compiles, and is the one with no frame before
        for sketch in before:
            method(sketch)
        started = time.process_time()
        clouds.append(method(sketches[-1]))
        times.append(time.process_time() - started)
    return _quality(clouds[0], trial) | {"cpu_ms": 1e3 * float(np.median(times[1:])), "points": len(clouds[0])}


def _quality(cloud, trial: Trial) -> dict:
    if trial.kept:
        return {"held_out_nats": held_out.gain(cloud, trial.case.sensor, *trial.kept)}
    found = judge(cloud, trial.case, trial.observation)
    return {"td_percent": found["true_detections_percent"], "fd_percent": found["false_detections_percent"],
            **{name: found[name] for name in ("dae_bins", "iae", "within_1_std_percent")}}


def _of_file(file: Path) -> Trial:
    bins = next(bins for pattern, bins in TOLERANCE_BINS.items() if fnmatch(file.stem, pattern))
    case, = of_files([str(file)], Tolerance(bins=bins), aligned=ALIGNED.get(file.stem, ()))
    observation = case.observe()
    kept = held_out.split(observation.frame) if observation.depth_bins is None else ()
    return Trial(case, lambda: [kept[0] if kept else observation.frame], observation, kept)


def _simulated(scene: str, sbr: float, ppp: float, surfaces: int) -> Trial:
    case, = simulated(scene, [sbr], [ppp], surfaces=surfaces)
    simulator = Simulator(NetScene(case.sensor) if scene == "net" else None, case.sensor, sbr, ppp, seed=1)
    observation = Observation(None, *simulator.expected(FRAMES - 1), complete=True)
    return Trial(case, lambda: [simulator.frame(k)[0] for k in range(FRAMES)], observation)
