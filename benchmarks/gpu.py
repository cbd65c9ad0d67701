"""What only a machine with a GPU can show: the same points as on the CPU, twice the same ones, and what a frame costs.

It needs torch with CUDA, numba and no ROS, and takes at most eight minutes. Each case compiles in a process of its own,
as many at once as there are cores, and is measured when all have, alone; those that have not by then are left out. The
lines become tables in benchmarks/results/gpu-NAME.md.
"""

import argparse
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from benchmarks.frames import PPP, PPPS, SIDE, SKETCH_SIZE, photons_of, sensor_of, timed
from benchmarks.table1 import PAPER_MS
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.gpu_check import share_alike
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.evaluation.scores import aligned

RESULTS, REPEATS, MEASURING_S = Path(__file__).parent / "results", 20, 80
FIELDS = "row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz"


class Case(NamedTuple):
    """What is compiled: a method for frames of side × side pixels, m frequencies and K surfaces."""

    method: str
    side: int
    m: int
    surfaces: int

    def reconstructor(self, device: str) -> tuple:
        """The reconstructor, and the frequencies of its sketches."""
        method, sensor = METHODS[self.method], sensor_of(self.side)
        frequencies = choose(method.frequencies, sensor, self.m)
        return method.build(sensor, frequencies, surfaces=self.surfaces, device=device), frequencies

    def line(self) -> dict:
        return {"method": self.method, "pixels": f"{self.side}x{self.side}", "m": self.m, "surfaces": self.surfaces}


USUAL = [Case(name, SIDE, SKETCH_SIZE, 1) for name in ("pooled", "srt3d")]         # of Figure 1, too
COMPARED = [*USUAL, Case("smle", SIDE, SKETCH_SIZE, 1), *(case._replace(surfaces=2) for case in USUAL)]
ALL = dict.fromkeys(COMPARED + [Case(name, side, m, 1) for name in ("pooled", "srt3d") for side, m in PAPER_MS])


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="cuda", help="cuda, or cpu to try the benchmark (%(default)s)")
    parser.add_argument("--most-pixels", type=int, default=10**6, help="of a frame; larger ones are left out")
    parser.add_argument("--minutes", type=float, default=7.5, help="for all of it (%(default)g)")
    parser.add_argument("--name", help="of the GPU, in the name of the file of results; default: torch's")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each measurement; behind them the file."""
    name = args.name or (torch.cuda.get_device_name() if args.device == "cuda" else "none")
    tables: dict[str, list[dict]] = {}
    try:
        for title, line in _measured(args):
            tables.setdefault(title, []).append(line)
            yield {"gpu": name} | line
    finally:        # what was measured before an error, too
        if args.device == "cuda":
            path = RESULTS / f"gpu-{name.replace(' ', '-')}.md"
            path.write_text(f"# {name}, torch {torch.__version__}\n\n" + "\n".join(map(_as_table, tables.items())))
            print(path)


def _measured(args: argparse.Namespace) -> Iterator[tuple[str, dict]]:
    """Lines, each with the title of its table."""
    cases = [case for case in ALL if case.side**2 <= args.most_pixels]
    latest = time.monotonic() + 60 * args.minutes - MEASURING_S
    with tempfile.TemporaryDirectory() as cache:
        os.environ |= {"TORCHINDUCTOR_CACHE_DIR": cache, "TORCHINDUCTOR_COMPILE_THREADS": "1"}
        with ThreadPoolExecutor(1) as beside:
            expected = {case: beside.submit(_on_cpu, case) for case in COMPARED}
            compiled = _compiled(cases, args.device, latest)
        for case in cases:
            measured = _asked(compiled[case][1]) if case in compiled else None
            if measured is None:
                yield "Time by size", case.line() | {"left out": "no time, or failed: see above"}
                continue
            line, clouds, by_photons = measured
            yield "Time by size", line | {"compiled_s": compiled[case][0]}
            if case in COMPARED:
                yield "The same points", case.line() | _agreement(case, *clouds, expected[case].result())
            for line in by_photons:
                yield "Figure 1: time by photons", line
        again = _compiled(USUAL[:1], args.device, latest + MEASURING_S)
        for seconds, _ in again.values():
            yield "Start with the kernels on the disk", USUAL[0].line() | {"start_s": seconds}


def _compiled(cases: list[Case], device: str, latest: float) -> dict[Case, tuple[float, Connection]]:
    """For each case that is ready by then: in how many seconds, and what asks its process to measure."""
    spawn, waiting, running, ready = multiprocessing.get_context("spawn"), list(cases), {}, {}
    with tqdm(total=len(cases), desc="compiling", disable=None, leave=False) as bar:
        while waiting or running:
            while waiting and len(running) < len(os.sched_getaffinity(0)):
                ours, theirs = spawn.Pipe()
                process = spawn.Process(target=_work, args=(waiting[0], device, theirs), daemon=True)
                process.start()
                theirs.close()
                running[ours] = waiting.pop(0), process
            for connection in wait(list(running), max(0, latest - time.monotonic())):
                (case, _), seconds = running.pop(connection), _received(connection)
                if seconds is not None:
                    ready[case] = seconds, connection
                bar.update()
            if time.monotonic() >= latest:
                break
    for _, process in running.values():
        process.kill()          # it would disturb what is measured
    return ready


def _asked(connection: Connection) -> tuple | None:
    """What a case measures."""
    connection.send("measure")
    return _received(connection)


def _received(connection: Connection):
    """What a process sends; None if it has ended instead, and has printed why."""
    try:
        return connection.recv()
    except EOFError:
        return None


def _work(case: Case, device: str, connection: Connection) -> None:
    """The process of a case."""
    began = time.perf_counter()
    reconstructor, frequencies = case.reconstructor(device)
    reconstructor.warm_up()
    connection.send(round(time.perf_counter() - began, 1))
    connection.recv()
    clouds, by_photons, sketch = [], [], _sketch(reconstructor.sensor, frequencies, PPP)
    for _ in range(2):
        reconstructor.forget()
        clouds.append(reconstructor(sketch))
    times = timed(lambda: reconstructor(sketch), REPEATS)
    line = case.line() | {
        "paper_ms": PAPER_MS.get((case.side, case.m)) if case.surfaces == 1 else None,
        "median_ms": round(times.median_ms, 2), "min_ms": round(min(times.ms), 2), "max_ms": round(max(times.ms), 2),
        "gpu_MB": round(torch.cuda.max_memory_reserved() / 1e6) if device == "cuda" else None}
    for ppp in PPPS if case in USUAL else ():
        sketch = _sketch(reconstructor.sensor, frequencies, ppp)
        reconstructor.forget()
        by_photons.append(case.line() | {
            "ppp": ppp, "median_ms": round(timed(lambda sketch=sketch: reconstructor(sketch), REPEATS).median_ms, 2)})
    connection.send((line, clouds if case in COMPARED else (), by_photons))


def _on_cpu(case: Case) -> Cloud:
    reconstructor, frequencies = case.reconstructor("cpu")
    return reconstructor(_sketch(reconstructor.sensor, frequencies, PPP))


def _sketch(sensor: SensorModel, frequencies: tuple[int, ...], ppp: float) -> Sketch:
    return sketch_photons(photons_of(sensor, ppp), sensor, frequencies)


def _agreement(case: Case, first: Cloud, second: Cloud, expected: Cloud) -> dict:
    """Of two clouds with each other, and with the CPU's."""
    same = all(np.array_equal(getattr(first, field), getattr(second, field), equal_nan=True) for field in FIELDS)
    alike = share_alike(first, expected, sensor_of(case.side).num_bins)
    return {"points": len(first), "points of the CPU": len(expected), "twice the same bits": same,
            "pixels as on the CPU %": round(100 * alike, 3)}


def _as_table(titled: tuple[str, list[dict]]) -> str:
    """A Markdown section of lines."""
    title, lines = titled
    heading = list(dict.fromkeys(key for line in lines for key in line))
    rows = [[str(line.get(key, "")) for key in heading] for line in lines]
    return f"## {title}\n\n{aligned([heading, *rows])}\n"
