"""Points, times and memory of frames on a GPU, compared with the CPU's points (eight minutes).

Needs torch with CUDA and numba, but no ROS. Each case compiles in a process of its own, one per core at a time. The
cases are then measured one after the other; those that have not compiled in time are left out. The lines are also
written as tables to benchmarks/results/gpu-NAME.md.
"""

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing.pool import Pool
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from benchmarks.frames import PPP, PPPS, SIDE, SKETCH_SIZE, photons_of, sensor_of, timed
from benchmarks.table1 import PAPER_MS
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.evaluation.scores import aligned
from srt3d_ros.gpu_check import share_alike

RESULTS, REPEATS, MEASURING_S = Path(__file__).parent / "results", 20, 80
FIELDS = "row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz"


class Case(NamedTuple):
    """A method for frames of side × side pixels, m frequencies and K surfaces."""

    method: str
    side: int
    m: int
    surfaces: int

    def reconstructor(self, device: str) -> tuple:
        """The reconstructor, and the frequencies of its sketches."""
        method, sensor = METHODS[self.method], sensor_of(self.side)
        frequencies = choose_frequencies(method.frequencies, sensor, self.m)
        return method.build(sensor, frequencies, surfaces=self.surfaces, device=device), frequencies

    def line(self) -> dict:
        return {"method": self.method, "pixels": f"{self.side}x{self.side}", "m": self.m, "surfaces": self.surfaces}


USUAL = [Case(name, SIDE, SKETCH_SIZE, 1) for name in ("pooled", "srt3d")]         # also timed by photons
COMPARED = [*USUAL, Case("smle", SIDE, SKETCH_SIZE, 1), *(case._replace(surfaces=2) for case in USUAL)]
ALL = dict.fromkeys(COMPARED + [Case(name, side, m, 1) for name in ("pooled", "srt3d") for side, m in PAPER_MS])
BUILT: dict[Case, tuple] = {}           # what Case.reconstructor gives, in the process of the case


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="cuda", help="cuda, or cpu to try this script (%(default)s)")
    parser.add_argument("--most-pixels", type=int, default=10**6, help="leave out larger frames (%(default)d)")
    parser.add_argument("--minutes", type=float, default=7.5, help="time for everything (%(default)g)")
    parser.add_argument("--name", help="name of the GPU in the results file (default: torch's)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each measurement; writes the results file at the end."""
    name = args.name or (torch.cuda.get_device_name() if args.device == "cuda" else "none")
    tables: dict[str, list[dict]] = {}
    try:
        for title, line in _measured(args):
            tables.setdefault(title, []).append(line)
            yield {"gpu": name} | line
    finally:        # keep what was measured before an error
        if args.device == "cuda":
            RESULTS.mkdir(exist_ok=True)
            path = RESULTS / f"gpu-{name.replace(' ', '-')}.md"
            path.write_text(f"# {name}, torch {torch.__version__}\n\n" + "\n".join(map(_as_table, tables.items())))
            print(path)


def _measured(args: argparse.Namespace) -> Iterator[tuple[str, dict]]:
    """The title of its table, and the line, of each measurement."""
    cases = [case for case in ALL if case.side**2 <= args.most_pixels]
    latest = time.monotonic() + 60 * args.minutes - MEASURING_S
    with tempfile.TemporaryDirectory() as cache:
        os.environ |= {"TORCHINDUCTOR_CACHE_DIR": cache, "TORCHINDUCTOR_COMPILE_THREADS": "1"}
        with ThreadPoolExecutor(1) as cpu:
            expected = {case: cpu.submit(_on_cpu, case) for case in COMPARED}
            compiled = _compiled(cases, args.device, latest)
        for case in cases:
            if case not in compiled:
                yield "Time by size", case.line() | {"left out": "not compiled in time, or failed: see above"}
                continue
            seconds, process = compiled[case]
            with process:
                line, clouds, by_photons = process.apply(_measure, (case, args.device))
            yield "Time by size", line | {"compiled_s": seconds}
            if case in COMPARED:
                yield "The same points", case.line() | _agreement(case, *clouds, expected[case].result())
            for line in by_photons:
                yield "Figure 1: time by photons", line
        again = _compiled(USUAL[:1], args.device, latest + MEASURING_S)
        for seconds, process in again.values():
            process.terminate()
            yield "Start with the kernels on the disk", USUAL[0].line() | {"start_s": seconds}


def _compiled(cases: list[Case], device: str, latest: float) -> dict[Case, tuple[float, Pool]]:
    """Compile each case in a process of its own; the compile time in seconds, and the process.

    Args:
        latest: `time.monotonic()` at which those that still compile are killed and left out.
    """
    spawn = multiprocessing.get_context("spawn")

    def compile_one(case: Case) -> tuple[float, Pool] | None:
        process = spawn.Pool(1)
        try:
            return process.apply_async(_compile, (case, device)).get(max(0, latest - time.monotonic())), process
        except Exception as error:      # of any case: the others are measured
            process.terminate()
            print(f"{case}: {error!r}", file=sys.stderr)
            return None

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as starters:
        done = list(tqdm(starters.map(compile_one, cases), "compiling", len(cases), disable=None, leave=False))
    return {case: found for case, found in zip(cases, done) if found}


def _compile(case: Case, device: str) -> float:
    """Compile a case, in its process; the seconds that this takes."""
    began = time.perf_counter()
    BUILT[case] = case.reconstructor(device)
    BUILT[case][0].warm_up()
    return round(time.perf_counter() - began, 1)


def _measure(case: Case, device: str) -> tuple[dict, list[PointCloud], list[dict]]:
    """The line of a case, two clouds of the same sketch, and lines by photons per pixel; in the process of the case."""
    reconstructor, frequencies = BUILT[case]
    clouds, by_photons, sketch = [], [], _sketch(reconstructor.sensor, frequencies, PPP)
    for _ in range(2):
        reconstructor.forget()
        clouds.append(reconstructor(sketch))
    line = case.line() | {"paper_ms": PAPER_MS.get((case.side, case.m)) if case.surfaces == 1 else None}
    line |= timed(partial(reconstructor, sketch), REPEATS).summary()
    line["gpu_MB"] = round(torch.cuda.max_memory_reserved() / 1e6) if device == "cuda" else None
    for ppp in PPPS if case in USUAL else ():
        sketch = _sketch(reconstructor.sensor, frequencies, ppp)
        reconstructor.forget()
        by_photons.append(case.line() | {"ppp": ppp} | timed(partial(reconstructor, sketch), REPEATS).summary())
    return line, clouds if case in COMPARED else [], by_photons


def _on_cpu(case: Case) -> PointCloud:
    reconstructor, frequencies = case.reconstructor("cpu")
    return reconstructor(_sketch(reconstructor.sensor, frequencies, PPP))


def _sketch(sensor: SensorModel, frequencies: tuple[int, ...], ppp: float) -> PhaseSums:
    return sketch_photons(photons_of(sensor, ppp), sensor, frequencies)


def _agreement(case: Case, first: PointCloud, second: PointCloud, expected: PointCloud) -> dict:
    """Whether two clouds have the same bits, and how many pixels are as in the CPU's cloud."""
    same = all(np.array_equal(getattr(first, field), getattr(second, field), equal_nan=True) for field in FIELDS)
    alike = share_alike(first, expected, sensor_of(case.side).num_bins)
    return {"points": len(first), "points of the CPU": len(expected), "twice the same bits": same,
            "pixels as on the CPU %": round(100 * alike, 3)}


def _as_table(titled: tuple[str, list[dict]]) -> str:
    """A Markdown section with a title and a table of these lines."""
    title, lines = titled
    heading = list(dict.fromkeys(key for line in lines for key in line))
    rows = [[str(line.get(key, "")) for key in heading] for line in lines]
    return f"## {title}\n\n{aligned([heading, *rows])}\n"
