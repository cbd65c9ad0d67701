"""The cases of ablation.py: frames as sketches, and what judges their clouds: a reference, or photons kept from them.

Photon files by their names, and simulated scenes named like `bust_1_10`: SBR 1, 10 photons per pixel.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from tqdm import tqdm

# What reads the method's constants is imported in functions: ablation.measure changes one before.
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.datasets.scene import NetScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.evaluation import held_out
from srt3d_ros.evaluation.cases import Case, Observation, of_files, simulated

SIMULATED = {f"{scene}_{sbr:g}_{ppp:g}": (scene, sbr, ppp, surfaces) for scene, sbr, ppp, surfaces in (
    ("bust", 10, 1, 1), ("bust", 1, 1, 1), ("bust", 1, 10, 1), ("bust", 0.1, 10, 1), ("bust", 1, 100, 1),
    ("net", 1, 10, 2))}                 # scene, SBR, photons per pixel, K; K of a file is its number of references
FRAMES = 3                              # of a simulated scene, which moves: the last is judged, warm_start sees all
SKETCH_SIZE = 10
TOLERANCE_BINS = {"room_64_*": "3", "*_72x88_*": "3", "mannequin_face_340": "40", "two_layer_100": "40", "*": "10"}
ALIGNED = {"two_layer_100": (1,)}       # references, from 0, to be shifted by their median offset from the cloud
HELD_OUT = 0.4          # share of the photons of a file without a reference that judges the cloud of the others


@dataclass(frozen=True)
class Trial:
    """Consecutive frames to reconstruct; the cloud of the last is judged.

    Args:
        case: sensor, K, tolerance.
        frames: makes the photons.
        observation: the reference, or held-out photons.
    """

    case: Case
    frames: Callable[[], list[PhotonEvents]]
    observation: Observation


def names_of(data: Path, patterns: list[str]) -> list[str]:
    """The cases whose name has one of the patterns."""
    every = [*sorted(file.stem for file in data.glob("*.npz")), *SIMULATED]
    return [name for name in every if any(fnmatch(name, pattern) for pattern in patterns)]


def open_trial(name: str, data: Path) -> Trial:
    """The case of a name; of a file without a reference, photons are held out."""
    if name in SIMULATED:
        scene, sbr, ppp, surfaces = SIMULATED[name]
        case, = simulated(scene, [sbr], [ppp], surfaces=surfaces)
        simulator = Simulator(NetScene(case.sensor) if scene == "net" else None, case.sensor, sbr, ppp, seed=1)
        return Trial(case, lambda: [simulator.frame(k)[0] for k in range(FRAMES)],
                     Observation(None, *simulator.expected(FRAMES - 1), complete=True))
    bins = next(bins for pattern, bins in TOLERANCE_BINS.items() if fnmatch(name, pattern))
    file, options = [str(data / f"{name}.npz")], {"tolerance": bins, "aligned": ALIGNED.get(name, ())}
    case, = of_files(file, **options)
    if case.observe().depth_bins is None:
        case, = of_files(file, **options, held_out_share=HELD_OUT)
    observation = case.observe()
    return Trial(case, lambda: [observation.frame], observation)


def save_sketches(names: list[str], data: Path, folder: Path) -> None:
    """Sketch the frames of the cases, into a file for each."""
    from srt3d_ros.core.frequencies import choose
    from srt3d_ros.core.sketching import sketch_photons
    for name in tqdm(names, unit="case", desc="sketching", leave=False):
        trial = open_trial(name, data)
        frequencies = choose("auto", trial.case.sensor, SKETCH_SIZE)
        sketches = [sketch_photons(frame, trial.case.sensor, frequencies) for frame in trial.frames()]
        np.savez(folder / f"{name}.npz", frequencies=frequencies, sums=[sketch.sums for sketch in sketches],
                 photons=[sketch.photons for sketch in sketches])


def load_sketches(name: str, folder: Path) -> list:
    """The sketches of a case."""
    from srt3d_ros.core.sketch import Sketch
    with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
        frequencies = tuple(map(int, file["frequencies"]))
        return [Sketch(frequencies, *maps) for maps in zip(file["sums"], file["photons"])]


def reconstruct(trial: Trial, sketches: list, options: dict, repeats: int) -> dict:
    """The metrics of one case: quality, CPU time of a frame (median of so many), number of points."""
    from srt3d_ros.core.methods import METHODS
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
    from srt3d_ros.evaluation.run import judge
    case, seen, kept = trial.case, trial.observation.frame, trial.observation.held_out
    if kept is not None:
        return {"held_out_nats": held_out.gain(cloud, case.sensor, seen, kept, case.held_out)["held_out_nats"]}
    found = judge(cloud, case, trial.observation)
    return {"td_percent": found["true_detections_percent"], "fd_percent": found["false_detections_percent"],
            **{name: found[name] for name in ("dae_bins", "iae", "within_1_std_percent")}}
