"""Growth with the photons: time and memory of a frame against photons per pixel, a line for each method."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from srt3d_ros.pictures.png import save_png

DPI = 100
# Okabe and Ito's colours (2008), as in `curves`; only our line is thick.
COLOURS = {"pooled": "#d55e00", "srt3d": "#0072b2", "smle": "#009e73", "xcorr": "#000000", "rt3d": "#a0527f",
           "sketching": "#8a8f98"}
MARKERS = {"pooled": "o", "srt3d": "s", "smle": "^", "xcorr": "D", "rt3d": "v", "sketching": "."}
OURS = "pooled"
TIME_LABELS = {"sketching": "sketching, while photons come", "rt3d": "rt3d (all photons)",
               "xcorr": "xcorr (histograms)"}
INPUT_LABELS = {"rt3d": "photons, for rt3d", "xcorr": "histograms, for xcorr", "pooled": "sketch, for the others"}
_GRID, _GOAL = "#d9dce0", "#6b7280"


def draw_growth(path: Path, lines: Sequence[dict], title: str, goal: tuple[float, str] | None,
                stopped: dict[str, str]) -> None:
    """Draw two panels on logarithmic axes.

    Left: median times in milliseconds, with the range from the fastest to the slowest run shaded. Right: the bytes of
    a frame's photons, histograms or sketch, and dotted the growth of the process during the reconstruction.

    Args:
        lines: with `method`, `ppp`, `ms` (min, median, max) and, where known, `input_bytes` and `growth_bytes`.
        goal: a time in milliseconds to draw as a line across, and its label; or None.
        stopped: methods whose lines end early, and a few words why.
    """
    figure = Figure((14.2, 6.0), dpi=DPI, layout="constrained")
    figure.suptitle(title, size=13, parse_math=False)
    by_method = {name: [line for line in lines if line["method"] == name] for name in COLOURS}
    by_method = {name: of_method for name, of_method in by_method.items() if of_method}
    time_ax, memory_ax = figure.subplots(1, 2)
    _draw_times(time_ax, by_method, goal, stopped)
    _draw_memory(memory_ax, by_method)
    save_png(figure, path)


def _draw_times(ax: Axes, by_method: dict[str, list[dict]], goal: tuple[float, str] | None,
                stopped: dict[str, str]) -> None:
    for name, lines in by_method.items():
        x = [line["ppp"] for line in lines]
        low, median, high = ([line["ms"][which] for line in lines] for which in ("min", "median", "max"))
        ax.fill_between(x, low, high, color=COLOURS[name], alpha=0.18, linewidth=0)
        label = f"{TIME_LABELS.get(name, name)}{': ' * (name in stopped)}{stopped.get(name, '')}"
        ax.plot(x, median, label=label, **_style(name) | {"linestyle": "--" if name == "sketching" else "-"})
    drawn = ax.get_lines()
    if goal is not None:
        ax.axhline(goal[0], color=_GOAL, linewidth=1.5, linestyle=(0, (6, 3)))
        ax.annotate(goal[1], (0.01, goal[0]), (0, -3), ("axes fraction", "data"), "offset points", va="top", size=9,
                    color=_GOAL, bbox={"color": "white", "alpha": 0.8, "pad": 0.5}, zorder=4)
    _format_axes(ax, drawn, "time of a frame, ms", "Time: from a sketch, or all photons, to the cloud")


def _draw_memory(ax: Axes, by_method: dict[str, list[dict]]) -> None:
    dotted = {"linestyle": ":", "linewidth": 1.3, "markersize": 3}
    for name, lines in by_method.items():
        for column, label, style in (("input_bytes", INPUT_LABELS.get(name), {}),
                                     ("growth_bytes", f"{name}, working" if name != "sketching" else None, dotted)):
            known = [(line["ppp"], line[column] / 1e6) for line in lines if line.get(column)]
            if label and known:
                ax.plot(*zip(*known), label=label, **_style(name) | style)
    _format_axes(ax, ax.get_lines(), "memory, MB",
                 "Memory: a frame's data (solid), and what the process grew by (dotted)")


def _style(name: str) -> dict:
    ours = name == OURS
    return {"color": COLOURS[name], "marker": MARKERS[name], "markersize": 6 if ours else 4.5,
            "linewidth": 3.0 if ours else 1.6, "zorder": 3 if ours else 2}


def _format_axes(ax: Axes, lines: Sequence[Line2D], label: str, title: str) -> None:
    ax.set_title(title, size=11, loc="left")
    ax.set(xscale="log", yscale="log", xlabel="photons per pixel (mean, with background)", ylabel=label)
    x = np.concatenate([line.get_xdata() for line in lines])
    ax.set_xlim(x.min() / 1.3, x.max() * 1.3)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
        axis.set_minor_formatter(NullFormatter())
        axis.set_major_formatter(lambda value, _: f"{value:,.0f}" if value >= 1 else f"{value:g}")
    ax.grid(color=_GRID)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    lines = sorted(lines, key=lambda line: line.get_ydata()[-1], reverse=True)         # as their ends are
    ax.legend(handles=lines, loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=9.5)
