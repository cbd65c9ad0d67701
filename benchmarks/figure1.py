"""Figure 1 of the SRT3D paper: the time of a frame against its photons, of methods on sketches and on all photons.

141 × 141 pixels, m = 10. Times are those of the reconstruction alone: from photons or from a sketch in memory to a
cloud in memory. Sketching, which goes on while the photons come, is timed beside it.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.frames import photons_of, sensor_of, timed
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.sketcher import Sketcher

SIDE, SKETCH_SIZE = 141, 10
PPPS = (1, 3.16, 10, 31.6, 100, 316, 1000)
STYLES = {"pooled": ("#d55e00", "o"), "srt3d": ("#0072b2", "s"), "smle": ("#009e73", "^"),
          "xcorr": ("#000000", "D"), "rt3d": ("#a0527f", "v"), "sketching": ("#8a8f98", ".")}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ppp", type=float, nargs="+", default=PPPS, help="photons a pixel")
    parser.add_argument("--side", type=int, default=SIDE, help="rows and columns (%(default)d)")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each (%(default)d)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the lines")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each number of photons and method."""
    sensor, lines = sensor_of(args.side), []
    for ppp in args.ppp:
        photons = photons_of(sensor, ppp)
        for name in STYLES:
            method = METHODS.get(name, METHODS["pooled"])
            sketcher = Sketcher(sensor, choose(method.frequencies, sensor, SKETCH_SIZE))
            sketcher.add(photons)
            frame = photons if method.needs == "photons" else sketcher.sketch()
            reconstructor = method.build(sensor, sketcher.frequencies, device="cpu")
            timing = timed((lambda: sketcher.add(photons)) if name == "sketching" else lambda: reconstructor(frame),
                           args.repeats)
            lines.append({"method": name, "ppp": ppp, "photons": photons.photons, "min_ms": round(min(timing.ms), 2),
                          "median_ms": round(timing.median_ms, 2), "max_ms": round(max(timing.ms), 2),
                          "growth_bytes": timing.growth_bytes})
            yield lines[-1]
    if args.picture:
        draw(args.picture, lines)


def draw(path: Path, lines: list[dict]) -> None:
    """Median times against photons per pixel, with the range of all runs shaded."""
    figure = Figure(figsize=(8, 5), dpi=100, layout="constrained")
    ax = figure.subplots()
    for name, (colour, marker) in STYLES.items():
        of_method = [line for line in lines if line["method"] == name]
        ppp, low, median, high = ([line[key] for line in of_method] for key in ("ppp", "min_ms", "median_ms", "max_ms"))
        ax.fill_between(ppp, low, high, color=colour, alpha=0.18, linewidth=0)
        ax.plot(ppp, median, color=colour, marker=marker, markersize=4.5, linewidth=3 if name == "pooled" else 1.6,
                linestyle="--" if name == "sketching" else "-", label=name)
    ax.set(xscale="log", yscale="log", xlabel="photons per pixel (mean, with background)", ylabel="time of a frame, ms")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.grid(color="#d9dce0")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    figure.savefig(path)
