"""Time and memory of a frame by image size, sketch size and photons: Table 1 and Figure 1 of the SRT3D paper.

    python -m benchmarks speed                                                      # Table 1
    python -m benchmarks speed --sides 141 --m 10 --methods all --ppp 1 3 10 30 100 300 1000 --picture time.png
    python -m benchmarks speed --device cuda --sides 141                            # a GPU; needs no ROS

The time is that of the reconstruction alone, from photons or a sketch in memory to a cloud in memory. Sketching, which
runs while photons arrive, has its own lines, and so has the yardstick, an FFT, which `x_fft` divides by. On a GPU, the
kernels compile first (`warm_up_s`), and a line also compares the cloud with that of the CPU.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from benchmarks.frames import PAPER_MS, PPP, photons_of, sensor_of, timed
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.gpu_check import share_alike

FFT_ROWS = 256              # histograms correlated at a time, 5 MB: they stay in the cache


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sides", type=int, nargs="+", default=[141, 282, 423, 564, 705], help="rows and columns")
    parser.add_argument("--m", type=int, nargs="+", default=[5, 10], help="sketch sizes")
    parser.add_argument("--ppp", type=float, nargs="+", default=[PPP], help="photons per pixel")
    parser.add_argument("--methods", nargs="+", choices=(*METHODS, "all"), default=["pooled", "srt3d"])
    parser.add_argument("--surfaces", type=int, default=1, help="K (%(default)d)")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each line (%(default)d)")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the times against photons per pixel")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each image size, number of photons, sketch size and method."""
    names, lines = list(METHODS) if "all" in args.methods else args.methods, []
    for side in args.sides:
        sensor = sensor_of(side)
        fft_ms = timed(fft(sensor), args.repeats)["median_ms"]
        for ppp in args.ppp:
            photons = photons_of(sensor, ppp)
            about = {"pixels": f"{side}x{side}", "ppp": ppp}
            lines.append(about | {"method": "fft", "median_ms": fft_ms})
            yield lines[-1]
            for m in args.m:
                for name in ("sketching", *names):
                    line = _measure(name, sensor, photons, m, args)
                    lines.append(about | {"method": name, "m": m} | line | {
                        "x_fft": round(line["median_ms"] / fft_ms, 4), "paper_ms": PAPER_MS.get((side, m))})
                    yield lines[-1]
    if args.picture:
        draw(args.picture, lines)


def _measure(name: str, sensor: SensorModel, photons: PhotonEvents, m: int, args: argparse.Namespace) -> dict:
    """Time and memory of sketching, or of a method on photons or their sketch."""
    if name == "sketching":
        sketcher = FrameSketcher(sensor, choose_frequencies(METHODS["pooled"].frequencies, sensor, m))
        return timed(lambda: sketcher.add(photons), args.repeats)
    method = METHODS[name]
    frequencies = choose_frequencies(method.frequencies, sensor, m)
    frame = photons if method.needs == "photons" else sketch_photons(photons, sensor, frequencies)
    device = args.device if method.needs == "sketch" else "cpu"
    reconstruct = method.build(sensor, frequencies, surfaces=args.surfaces, device=device)
    began = time.perf_counter()
    reconstruct.warm_up()           # compiles, and allocates what would otherwise count as the frame's memory
    line = {"device": device, "surfaces": args.surfaces, "warm_up_s": round(time.perf_counter() - began, 2)}
    line |= timed(lambda: reconstruct(frame), args.repeats)
    if device == "cuda":
        line |= _compared(reconstruct, method.build(sensor, frequencies, surfaces=args.surfaces, device="cpu"), frame)
    return line


def _compared(on_gpu: Callable, on_cpu: Callable, frame: object) -> dict:
    """The GPU's memory, whether it repeats its bits, and how many pixels have the same points as on the CPU."""
    import torch

    on_gpu.forget()
    first = on_gpu(frame)
    on_gpu.forget()
    second = on_gpu(frame)
    same = all(np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True) for name in POINT_FIELDS)
    alike = share_alike(first, on_cpu(frame), first.sensor.num_bins)
    return {"gpu_MB": round(torch.cuda.max_memory_reserved() / 1e6), "same_bits_twice": same,
            "as_on_the_cpu_percent": round(100 * alike, 3)}


def fft(sensor: SensorModel) -> Callable[[], None]:
    """The yardstick: correlates a histogram of each pixel with the IRF by SciPy's FFT, float32, on all threads.

    The same block of histograms stands for all of them, so that none is loaded from memory.
    """
    length = next_fast_len(sensor.num_bins + sensor.irf.shape[-1] - 1, real=True)
    spectrum = np.conj(rfft(sensor.irf.astype(np.float32), length))
    block = np.random.default_rng(0).poisson(0.01, (FFT_ROWS, sensor.num_bins)).astype(np.float32)

    def call() -> None:
        for first in range(0, sensor.pixels, FFT_ROWS):
            seen = block[:sensor.pixels - first]
            irfft(rfft(seen, length, axis=1, workers=-1) * spectrum, length, axis=1, workers=-1).argmax(axis=1)
    return call


def draw(path: Path, lines: Sequence[dict]) -> None:
    """Draw median times against photons per pixel, a curve for each method."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 5), layout="constrained")
    for name in (*METHODS, "sketching", "fft"):
        if points := [(line["ppp"], line["median_ms"]) for line in lines if line["method"] == name]:
            axes.loglog(*zip(*points), "o-", label=name, linewidth=3 if name == "pooled" else 1.5)
    axes.set(xlabel="photons per pixel, with background", ylabel="time of a frame, ms")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right center", frameon=False)
    figure.savefig(path, dpi=200)
