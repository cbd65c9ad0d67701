"""Accuracy of `pooled` with each of its constants halved, doubled and off.

    python -m benchmarks ablation                               # everything: two hours on two cores
    python -m benchmarks ablation --constants VOTE,SPREAD --only "head*,room*" --draws 4

Each set of photons is drawn several times: a simulated scene with other seeds, a photon file by keeping each photon
with the probability in `FILES`. All variants see the same draws, so changes are paired. The first line has the means
with the default constants, and the names of all numbers of the method: varied, fixed (FIXED says why), and those that
follow from others. Every other line has, for each set, the mean change of true and false detections (percentage
points) and of the depth error (%), each with its standard error.
"""

import argparse
import ast
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tqdm import tqdm

from srt3d_ros import datasets
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.motion.moving_sketcher import MovingSketcher
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.evaluation.cases import SCENES as EVALUATED
from srt3d_ros.evaluation.cases import simulated
from srt3d_ros.kernels import constants

if TYPE_CHECKING:
    from benchmarks.motion import Walk

REPOSITORY = Path(__file__).resolve().parents[1]
SKETCH_SIZE = 10
# Probability of keeping a photon, and τ in bins. The file of the head has 419 photons per pixel.
FILES = {"art_real_unif_ppp5_sbr0.1": (0.8, 10), "art_real_unif_ppp5_sbr1": (0.8, 10),
         "art_real_unif_ppp5_sbr10": (0.8, 10), "polystyrene_head_142_full, 1 ppp": (1 / 419, 10),
         "polystyrene_head_142_full, 10 ppp": (10 / 419, 10), "room_64_2_50": (0.8, 3), "room_64_10_50": (0.8, 3),
         "bowling_72x88_2_100": (0.8, 3), "reindeer_72x88_2_100": (0.8, 3), "two_layer_100": (0.8, 40)}
# Scene of `srt3d evaluate`, SBR, photons per pixel, whether there is fog.
SCENES = {"bust, SBR 1, 1 ppp": ("bust", 1, 1, False), "bust, SBR 0.1, 10 ppp": ("bust", 0.1, 10, False),
          "bust in fog, SBR 1, 10 ppp": ("bust", 1, 10, True), "net, SBR 1, 10 ppp": ("net", 1, 10, False)}
DIM = {"dim disc, SBR 10": 0.2, "dim rods, SBR 10": 1.0}      # signal photons of a pixel with a surface
WIDE, RETRO = "wall, IRF 10 % too wide, two surfaces", "retro-reflector before a wall, two surfaces"
MODULES = ("core.method.matched_frame", "core.method.background", "core.method.thresholds", "core.method.pooled",
           "core.method.pile_up")
# Not varied, by reason.
FIXED = {"limits of inputs": ("MAX_SKETCH_SIZE", "MAX_PIXEL_PHOTONS", "MAX_SURFACES", "*_FALSE_ALARM_RATE"),
         "rounding": ("TINY", "EPSILON", "RIDGE"), "speed alone": ("CELL", "PLANE_STEP"),
         "baselines": ("INTENSITY_RATE", "APSS_*"),
         "steps of a solution that has converged": ("PASSES", "NEWTON_STEPS", "PLANE_TURNS"),
         "sampling of tables": ("FLUXES", "TABLE_STEPS", "BETWEEN"),
         "widen depth_std alone": ("SATURATED", "RELIEF_SCORE"),
         "powers that mean intensity, depth, width and skew": ("CORRECTED",),
         "sensors with an IRF for each pixel": ("WEAKEST_PASSBAND",)}
# Instead of half and twice: MARGIN allows a REACH of 1.77; with more than four sides nothing is a hole.
OTHER = {"START_SCALES": [(0.0, 2.5)], "WINDOWS": [((2.0, 4, 2), (9.0, 4, 1))], "REACH": [1.0, 1.75],
         "HOLE_SIDES": [2, 5]}
OFF = {"LIKENESS": 1e6, "VOTE": 0, "MAX_VOTES": 1e6, "EMPTY_VOTES": 0, "SPREAD": 0, "WRONG_IRF": 0, "SHARP": 1,
       "NEW_RADIUS": 0, "WRONG_SHAPE": 0, "WHOLE_SCORE": -100}


class Draw(NamedTuple):
    """A sketch of one draw of the photons, and the truth that its cloud is judged against."""

    sketch: PhaseSums
    sensor: SensorModel
    depth_bins: np.ndarray              # [K, rows, cols]
    tolerance_bins: float
    complete: bool


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared/data/photons", metavar="DIR",
                        help="folder of the photon files (%(default)s)")
    parser.add_argument("--constants", default="*", metavar="A,B", help="only these; * and ? as in file names")
    parser.add_argument("--only", default="*", metavar="SET,…", help="only these sets; * and ? as in file names")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE[;NAME=VALUE]",
                        help="instead of all constants, one variant with these values; may be repeated")
    parser.add_argument("--draws", type=int, default=10, metavar="N", help="draws of each set (%(default)s)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N",
                        help="processes at a time, one thread each (%(default)s)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    chosen = {name: draw for name, draw in sets(args.data).items() if fits(name, args.only)}
    variants = [{name: ast.literal_eval(value) for name, value in (pair.split("=") for pair in text.split(";"))}
                for text in args.set] or list(halved_doubled_off(args.constants))
    with TemporaryDirectory() as folder, ThreadPoolExecutor(args.jobs) as pool:
        for name, draw in tqdm(chosen.items(), "drawing photons", unit="set"):
            Path(folder, f"{name}.pickle").write_bytes(pickle.dumps([draw(seed) for seed in range(args.draws)]))
        measured = pool.map(lambda variant: measure_apart(variant, folder), [{}, *variants])
        default = next(measured)
        yield {"variant": "default", **listed(), "sets": {name: np.nanmean(rows, 0).round(3).tolist()
                                                          for name, rows in default.items()}}
        for variant, rows in zip(tqdm(variants, unit="variant"), measured):
            yield {"variant": variant, "sets": {name: changes(default[name], rows[name]) for name in rows}}


def fits(name: str, patterns: str) -> bool:
    return any(fnmatch(name, pattern) for pattern in patterns.split(","))


def numbers() -> dict[str, tuple[str, ast.expr]]:
    """Module and expression of every number that the method's modules name."""
    found = {}
    for module in (constants.__name__, *(f"srt3d_ros.{name}" for name in MODULES)):
        for node in ast.parse(Path(find_spec(module).origin).read_text()).body:
            if isinstance(node, ast.Assign):
                names = [name.id for name in ast.walk(node.targets[0]) if isinstance(name, ast.Name)]
                found |= {name: (module, node.value) for name in names if name.isupper() and name != "BACKGROUNDS"}
    return found


def following(names: Iterable[str]) -> set[str]:
    """The numbers that are computed from `names`."""
    return {name for name, (_, value) in numbers().items() if any(
        isinstance(part, ast.Name) and part.id in names for part in ast.walk(value))}


def listed() -> dict:
    """The names of the numbers that are varied, fixed, and follow from others."""
    found, kept = numbers(), ",".join(name for names in FIXED.values() for name in names)
    follow = following(found)
    fixed = [name for name in found if fits(name, kept) and name not in follow]
    varied = [name for name in found if name not in (*fixed, *follow)]
    return {"varied": varied, "fixed": fixed, "follow": sorted(follow)}


def halved_doubled_off(patterns: str) -> Iterator[dict]:
    """Variants of each constant: halved, doubled and off, or as in OTHER."""
    for name in listed()["varied"]:
        if fits(name, patterns):
            value = getattr(import_module(numbers()[name][0]), name)
            tried = OTHER[name] if name in OTHER else [half(value), 2 * value]
            tried = tried + ([type(value)(OFF[name])] if name in OFF else [])
            yield from ({name: new} for new in dict.fromkeys(tried) if new != value)


def half(number):
    """Half the number; for an integer, at least 1."""
    return max(1, round(number / 2)) if isinstance(number, int) else number / 2


def sets(data: Path) -> dict[str, Callable[[int], Draw]]:
    """What draws the photons of each set, by seed."""
    return {**{name: partial(kept, data / f"{name.partition(',')[0]}.npz", *how) for name, how in FILES.items()},
            **{name: partial(seen, *how) for name, how in SCENES.items()},
            "room from a moving sensor, 3 ppp": moving, "steep wall, SBR 0.1, 20 ppp": steep,
            **{name: partial(lit, name) for name in (*DIM, WIDE, RETRO)}}


def kept(path: Path, share: float, tolerance: float, seed: int) -> Draw:
    """A share of the photons of a file."""
    photons = datasets.read(path)
    frame = photons.events.part(np.random.default_rng(seed).random(photons.events.photons) < share)
    return drawn(photons.sensor, frame, photons.reference_depth_bins, tolerance, False)


def seen(scene: str, sbr: float, ppp: float, fog: bool, seed: int) -> Draw:
    """A simulated scene of `srt3d evaluate`."""
    case, = simulated(scene, [sbr], [ppp])
    fogged = case.sensor.replace(background_shape=np.exp(-np.arange(case.sensor.num_bins) / 60) + 0.02)
    simulator = Simulator(EVALUATED[scene][0](case.sensor), fogged if fog else case.sensor, sbr, ppp, seed)
    return drawn(case.sensor, *simulator.frame(0), case.tolerance_bins)


def steep(seed: int) -> Draw:
    """A wall that rises by four σ of the IRF per column and by two per row."""
    sensor, (row, col) = SensorModel(40, 40, 1000, 1e-10, np.exp(-np.arange(-16, 17)**2 / 32)), np.mgrid[:40, :40]
    scene = StaticScene(sensor.range_m(370.0 + 14.3 * col - 8.2 * row))
    return drawn(sensor, *Simulator(scene, sensor, 0.1, 20, 100 + seed).frame(0), 12)


@cache
def walked() -> "Walk":
    from benchmarks.motion import Walk  # which imports what must not be imported before constants are set

    return Walk(range(1))


def moving(seed: int) -> Draw:
    """One frame of a walk through the room, deskewed."""
    walk = walked()
    sketch = MovingSketcher(walk.sensor, walk.frequencies).finish(
        walk.frame(0, walk.moving(3, seed=seed)), walk.trajectory)
    return Draw(sketch, walk.sensor, walk.at_rest(3).expected(0)[0], 10, True)


def lit(name: str, seed: int) -> Draw:
    """Photons that are drawn here, on 64 × 64 pixels: dim shapes before nothing, and two surfaces a pixel."""
    rng, (row, col) = np.random.default_rng(seed), np.mgrid[:64, :64]
    far = np.hypot(row - 32, col - 32)
    depth, photons, width = np.full((2, 64, 64), np.nan), np.zeros((2, 64, 64)), 1.0
    depth[0] = 420.3 + 0.3 * row
    if name in DIM:
        there = far < 20 if "disc" in name else col % 16 // 2 == 3
        depth, photons = np.where(there, depth[:1], np.nan), DIM[name] * there[None]
        background = DIM[name] / 10
    elif name == WIDE:
        photons[0], background, width = 2000, 20, 1.1
    else:           # ten thousand times the light of the wall, a halo of 0.1 %
        photons[0], background = 50, 10
        depth[1] = np.where(far < 40, 270.3, np.nan)
        photons[1] = np.where(far < 4, 50000, 50 * np.exp((4 - far) / 8)) * (far < 40)
        photons[0, far < 4] = 0
        depth[0, far < 4] = np.nan
    bins = np.arange(-24, 25)
    sensor = SensorModel(64, 64, 1000, 1e-11, np.exp(-bins**2 / (2 * (4 * width)**2)))
    place = np.repeat(np.arange(photons.size), rng.poisson(photons).ravel())
    pixel, toa = place % 4096, depth.ravel()[place] + 4 * rng.standard_normal(len(place))
    other = rng.poisson(background * 4096)
    frame = PhotonEvents(np.r_[pixel, rng.integers(0, 4096, other)].astype(np.uint32),
                         np.r_[np.rint(toa) % 1000, rng.integers(0, 1000, other)].astype(np.uint16))
    return drawn(sensor, frame, depth, 12)


def drawn(sensor: SensorModel, frame: PhotonEvents, depth: np.ndarray, tolerance: float, complete: bool = True) -> Draw:
    sketch = sketch_photons(frame, sensor, choose_frequencies("auto", sensor, SKETCH_SIZE))
    return Draw(sketch, sensor, depth, tolerance, complete)


def measure_apart(variant: dict, folder: str) -> dict[str, np.ndarray]:
    """TD and FD (%) and DAE (bins) of each set, [draws, 3], measured in a process that compiles this variant.

    It takes the default's kernels, from where this user keeps them, if no constant of theirs is varied.
    """
    with TemporaryDirectory() as empty:
        compiled = {} if all(name not in vars(constants) for name in variant) else {"NUMBA_CACHE_DIR": empty}
        done = subprocess.run([sys.executable, "-m", "benchmarks.ablation", repr(variant), folder], cwd=REPOSITORY,
                              env=os.environ | compiled | {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                              stdout=subprocess.PIPE, check=True)
    return {name: np.array(rows) for name, rows in json.loads(done.stdout).items()}


def measure(variant: dict, folder: str) -> dict[str, list]:
    """Set the constants, then judge each draw. This runs in the process of a variant.

    Modules read the constants when they are imported, so this file must not import the kernels or
    `core.method.pooled` at its top.
    """
    if "WINDOWS" in variant:
        variant["WINDOWS"] = tuple(constants.Window(*each) for each in variant["WINDOWS"])
    follow = following(numbers())
    for name, (module, value) in numbers().items():         # in order, so that others follow
        if name in variant:
            setattr(import_module(module), name, variant[name])
        elif module == constants.__name__ and name in follow:
            own = compile(ast.Expression(value), module, "eval")
            setattr(constants, name, eval(own, vars(constants)))        # noqa: S307, the module's own line
    from srt3d_ros.core.method.pooled import Pooled

    rows = {}
    for path in sorted(Path(folder).glob("*.pickle")):
        found = []
        for draw in pickle.loads(path.read_bytes()):        # noqa: S301, written by `run` a moment ago
            pooled = Pooled(draw.sensor, draw.sketch.frequencies, len(draw.depth_bins))
            judged = evaluate(pooled(draw.sketch), draw.depth_bins, draw.tolerance_bins, draw.sensor.num_bins,
                              complete=draw.complete)
            found.append((100 * judged.true_detections, 100 * judged.false_detections, judged.dae_bins))
        rows[path.stem] = found
    return rows


def changes(before: np.ndarray, after: np.ndarray) -> list[str]:
    """Mean ± standard error of the changes of TD and FD (percentage points) and DAE (%)."""
    several = np.column_stack([(after - before)[:, :2], 100 * (after[:, 2] / before[:, 2] - 1)])
    error = several.std(0, ddof=1) / len(several)**0.5
    return [f"{mean:+.2f} ± {one:.2f}" for mean, one in zip(several.mean(0), error)]


if __name__ == "__main__":
    print(json.dumps(measure(ast.literal_eval(sys.argv[1]), sys.argv[2])))
