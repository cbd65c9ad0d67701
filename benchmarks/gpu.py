"""What only a machine with a GPU can show: the same points as on the CPU, twice the same ones, and what a frame costs.

It needs torch with CUDA, numba and no ROS, takes at most eight minutes, and says what it had no time for; most of them
pass compiling. The lines become tables in benchmarks/results/gpu-NAME.md.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch

from benchmarks import table1
from benchmarks.frames import PPP, PPPS, SIDE, SKETCH_SIZE, photons_of, sensor_of, timed
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.method.gpu_check import share_alike
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.evaluation.results import aligned

ON_GPU = [name for name, method in METHODS.items() if "device" in method.options]
RESULTS = Path(__file__).parent / "results"
START = """
import sys, time
from benchmarks.gpu import built
began = time.perf_counter()
built("pooled", int(sys.argv[1]), sys.argv[2])
print(time.perf_counter() - began)
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", default="cuda", help="cuda, or cpu to try the benchmark (%(default)s)")
    parser.add_argument("--side", type=int, default=SIDE, help="rows and columns, but for Table 1 (%(default)d)")
    parser.add_argument("--minutes", type=float, default=7.0, help="after which nothing more begins (%(default)g)")
    parser.add_argument("--name", help="of the GPU, in the name of the file of results; default: torch's")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each measurement; behind them the file."""
    is_gpu = args.device == "cuda"
    name = args.name or (torch.cuda.get_device_name() if is_gpu else "none")
    ends, tables = time.monotonic() + 60 * args.minutes, {}
    try:
        for title, measure in (("Start of a reconstruction", starts), ("The same points", agreement),
                               ("Figure 1: time by photons", photons), ("Table 1: time by size", sizes)):
            tables[title] = []
            for line in measure(args, lambda: time.monotonic() > ends):
                tables[title].append(line)
                yield {"gpu": name} | line
    finally:        # what was measured before an error, too
        if is_gpu:
            path = RESULTS / f"gpu-{name.replace(' ', '-')}.md"
            path.write_text(f"# {name}, torch {torch.__version__}\n\n" + "\n".join(map(_as_table, tables.items())))
            print(path)


def built(method: str, side: int, device: str) -> tuple[Callable[[Sketch], PointCloud], tuple[int, ...]]:
    """A reconstruction that has compiled all that it needs, and its frequencies."""
    sensor = sensor_of(side)
    frequencies = choose(METHODS[method].frequencies, sensor, SKETCH_SIZE)
    reconstructor = METHODS[method].build(sensor, frequencies, device=device)
    reconstructor.warm_up()
    return reconstructor, frequencies


def starts(args: argparse.Namespace, is_late: Callable[[], bool]) -> Iterator[dict]:
    """With nothing compiled, and with what torch then keeps on the disk; each in a process of its own."""
    with tempfile.TemporaryDirectory() as cache:
        for what in ("first", "again"):
            done = subprocess.run([sys.executable, "-c", START, str(args.side), args.device], text=True, check=True,
                                  stdout=subprocess.PIPE, env=os.environ | {"TORCHINDUCTOR_CACHE_DIR": cache})
            yield {"start": what, "pixels": f"{args.side}x{args.side}", "s": round(float(done.stdout.split()[-1]), 1)}


def agreement(args: argparse.Namespace, is_late: Callable[[], bool]) -> Iterator[dict]:
    """Of each method with itself on the CPU, and of two runs with each other."""
    photons = photons_of(sensor_of(args.side), PPP)
    for name in ON_GPU:
        if is_late():
            yield {"method": name, "left out": "no time"}
            continue
        (ours, frequencies), (theirs, _) = (built(name, args.side, device) for device in (args.device, "cpu"))
        sensor, clouds = ours.sensor, []
        sketch = sketch_photons(photons, sensor, frequencies)
        for reconstructor in (ours, ours, theirs):
            reconstructor.forget()
            clouds.append(reconstructor(sketch))
        first, second, expected = clouds
        same = all(np.array_equal(getattr(first, field), getattr(second, field), equal_nan=True)
                   for field in ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz"))
        yield {"method": name, "points": len(first), "twice the same bits": same, "pixels as on the CPU %": round(
            100 * share_alike(first, expected, sensor.num_bins), 3)}


def sizes(args: argparse.Namespace, is_late: Callable[[], bool]) -> Iterator[dict]:
    """`table1`, as far as there is time."""
    if args.device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    for line in table1.run(argparse.Namespace(device=args.device, repeats=20)):
        if args.device == "cuda":
            line["gpu_bytes"] = torch.cuda.max_memory_allocated()
            torch.cuda.reset_peak_memory_stats()
        yield line
        if is_late():
            yield {"left out": "what follows in PAPER_MS: no time"}
            return


def photons(args: argparse.Namespace, is_late: Callable[[], bool]) -> Iterator[dict]:
    """From 1 to 1,000 photons a pixel."""
    for name in ("pooled", "srt3d"):
        if is_late():
            yield {"left out": f"{name}: no time"}
            continue
        reconstructor, frequencies = built(name, args.side, args.device)
        for ppp in PPPS:
            if is_late():
                yield {"left out": f"{name} from {ppp} ppp on: no time"}
                break
            sketch = sketch_photons(photons_of(reconstructor.sensor, ppp), reconstructor.sensor, frequencies)
            reconstructor.forget()
            timing = timed(lambda: reconstructor(sketch), 20)
            yield {"method": name, "ppp": ppp, "median_ms": round(timing.median_ms, 2)}


def _as_table(titled: tuple[str, list[dict]]) -> str:
    """A Markdown section of lines."""
    title, lines = titled
    heading = list(dict.fromkeys(key for line in lines for key in line))
    rows = [[str(line.get(key, "")) for key in heading] for line in lines]
    return f"## {title}\n\n{aligned([heading, *rows])}\n"
