"""Time of a frame against its photons, by method: Figure 1 of the SRT3D paper.

141 × 141 pixels, m = 10. The time is that of the reconstruction alone, from photons or a sketch in memory to a cloud in
memory. Sketching, which runs while photons arrive, has its own line, and so has an FFT, which `x_fft` divides by.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.frames import PPPS, SIDE, SKETCH_SIZE, fft, photons_of, sensor_of, timed
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.evaluation.scores import aligned
from srt3d_ros.pictures.curves import METHOD_COLOURS, Metric, format_axes
from srt3d_ros.pictures.figures import save_png

PHOTONS = "photons per pixel, with background"
IN_TABLE = (1, 10, 100, 1000)       # photons per pixel
STYLES = {name: {"color": colour, "marker": marker, "markersize": 4.5, "linewidth": 3 if name == "pooled" else 1.6}
          for name, colour, marker in zip(METHODS, METHOD_COLOURS, "os^Dv")}
STYLES["sketching"] = {"color": "#8a8f98", "marker": ".", "linestyle": "--"}
STYLES["fft"] = {"color": "#8a8f98", "marker": "", "linestyle": ":"}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ppp", type=float, nargs="+", default=PPPS, help="photons per pixel")
    parser.add_argument("--side", type=int, default=SIDE, help="rows and columns (%(default)d)")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each method (%(default)d)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="picture to draw; a table (.md) goes beside it")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each number of photons and method."""
    sensor, lines = sensor_of(args.side), []
    for ppp in args.ppp:
        photons = photons_of(sensor, ppp)
        for name in STYLES:
            timing = timed(_call(name, sensor, photons), args.repeats)
            lines.append({"method": name, "ppp": ppp, "photons": photons.photons} | timing.summary()
                         | {"growth_bytes": timing.growth_bytes})
        fft_ms = lines[-1]["median_ms"]
        for line in lines[-len(STYLES):]:
            yield line | {"x_fft": round(line["median_ms"] / fft_ms, 4)}
    if args.picture:
        draw(args.picture, lines)
        write_table(args.picture, lines, "ms", "{median_ms:.3g}")


def _call(name: str, sensor: SensorModel, photons: PhotonEvents) -> Callable[[], object]:
    """What a line of STYLES times: a method on photons or their sketch, sketching, or the FFT."""
    if name == "fft":
        return fft(sensor)
    method = METHODS.get(name, METHODS["pooled"])
    sketcher = FrameSketcher(sensor, choose_frequencies(method.frequencies, sensor, SKETCH_SIZE))
    if name == "sketching":
        return lambda: sketcher.add(photons)
    sketcher.add(photons)
    frame = photons if method.needs == "photons" else sketcher.end_frame()
    reconstructor = method.build(sensor, sketcher.frequencies, device="cpu")
    return lambda: reconstructor(frame)


def draw(path: Path, lines: Sequence[dict]) -> None:
    """Draw median times against photons per pixel, with the range of all runs shaded."""
    figure = Figure(figsize=(8, 5), dpi=200, layout="constrained")
    ax = figure.subplots()
    for name, style in STYLES.items():
        of_method = [line for line in lines if line["method"] == name]
        ppp, low, median, high = ([line[key] for line in of_method] for key in ("ppp", "min_ms", "median_ms", "max_ms"))
        ax.fill_between(ppp, low, high, color=style["color"], alpha=0.18, linewidth=0)
        ax.plot(ppp, median, label=name, **style)
    format_axes(ax, Metric("median_ms", "time of a frame, ms", "log"))
    ax.set(xlabel=PHOTONS, ylabel="time of a frame, ms")
    figure.legend(loc="outside right center", frameon=False)
    save_png(figure, path)


def write_table(picture: Path, lines: Sequence[dict], title: str, cell: str) -> None:
    """Write a Markdown table beside the picture: a row for each method, a column for each number of photons.

    Args:
        title: heading of the first column: what the cells hold.
        cell: format string that makes a cell from a line.
    """
    cells = {(line["method"], line["ppp"]): cell.format(**line) for line in lines}
    columns = [ppp for ppp in IN_TABLE if any(ppp == measured for _, measured in cells)]
    heading = [title, *(f"{ppp:,g} ppp" for ppp in columns)]
    rows = [[name, *(cells[name, ppp] for ppp in columns)] for name in STYLES if (name, columns[0]) in cells]
    picture.with_suffix(".md").write_text(aligned([heading, *rows]) + "\n", encoding="utf-8")
