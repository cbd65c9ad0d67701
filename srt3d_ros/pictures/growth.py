"""Time and memory of a frame against its photons, a line for each method, labelled at its end."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from srt3d_ros.pictures.png import save_png

DPI = 100
# Of Okabe and Ito (2008), as in `curves`; ours is the only thick line.
COLOURS = {"pooled": "#d55e00", "srt3d": "#0072b2", "smle": "#009e73", "xcorr": "#000000", "rt3d": "#a0527f",
           "sketching": "#8a8f98"}
MARKERS = {"pooled": "o", "srt3d": "s", "smle": "^", "xcorr": "D", "rt3d": "v", "sketching": "."}
OURS = "pooled"
TIME_LABELS = {"sketching": "sketching, while photons come", "rt3d": "rt3d (all photons)",
               "xcorr": "xcorr (histograms)"}
INPUT_LABELS = {"rt3d": "photons, for rt3d", "xcorr": "histograms, for xcorr", "pooled": "sketch, for the others"}
_GRID, _GOAL = "#d9dce0", "#6b7280"
_HIGHEST = 0.97             # label: the title is above
_LABEL_GAP = 0.047          # of the height, between the middles of two labels


@dataclass(frozen=True, eq=False)
class _Line:
    """x and y of a line, what stands at its end, and how it is drawn."""

    label: str
    x: np.ndarray
    y: np.ndarray
    style: dict


def draw_growth(path: Path, lines: Sequence[dict], title: str, goal: tuple[float, str] | None,
                stopped: dict[str, str]) -> None:
    """Two panels on logarithmic axes.

    Left: medians of the times in milliseconds, from the fastest to the slowest run shaded. Right: the bytes that a
    frame's photons, histograms or sketch take, and dotted those that the process grew by while it was reconstructed.

    Args:
        lines: with `method`, `ppp`, `ms` (min, median, max) and, where known, `input_bytes` and `growth_bytes`.
        goal: a time in milliseconds to draw as a line across, and what to write on it; or None.
        stopped: methods whose lines end early, and why, in a word or two.
    """
    figure = Figure((14.2, 6.0), dpi=DPI, layout="constrained")
    figure.suptitle(title, size=13, parse_math=False)
    time_ax, memory_ax = figure.subplots(1, 2)
    methods = [name for name in COLOURS if any(line["method"] == name for line in lines)]
    _draw_times(time_ax, [[line for line in lines if line["method"] == name] for name in methods], goal, stopped)
    _draw_memory(memory_ax, [[line for line in lines if line["method"] == name] for name in methods])
    save_png(figure, path)


def _draw_times(ax: Axes, by_method: Sequence[list[dict]], goal: tuple[float, str] | None,
                stopped: dict[str, str]) -> None:
    drawn = []
    for lines in by_method:
        name, x = lines[0]["method"], np.array([line["ppp"] for line in lines])
        low, median, high = (np.array([line["ms"][which] for line in lines]) for which in ("min", "median", "max"))
        ax.fill_between(x, low, high, color=COLOURS[name], alpha=0.18, linewidth=0)
        dashes = "--" if name == "sketching" else "-"
        label = f"{TIME_LABELS.get(name, name)}{': ' * (name in stopped)}{stopped.get(name, '')}"
        drawn.append(_Line(label, x, median, _style(name) | {"linestyle": dashes}))
    if goal is not None:
        ax.axhline(goal[0], color=_GOAL, linewidth=1.5, linestyle=(0, (6, 3)))
        ax.annotate(goal[1], (0.01, goal[0]), (0, -3), ("axes fraction", "data"), "offset points", va="top", size=9,
                    color=_GOAL, bbox={"color": "white", "alpha": 0.8, "pad": 0.5}, zorder=4)
    _finish(ax, drawn, "time of a frame, ms", "Time: from a sketch, or all photons, to the cloud")


def _draw_memory(ax: Axes, by_method: Sequence[list[dict]]) -> None:
    drawn = []
    for lines in by_method:
        name = lines[0]["method"]
        if name in INPUT_LABELS:
            drawn += _line(INPUT_LABELS[name], lines, "input_bytes", _style(name))
        if name != "sketching":
            drawn += _line(f"{name}, working", lines, "growth_bytes",
                           _style(name) | {"linestyle": ":", "linewidth": 1.3, "markersize": 3})
    _finish(ax, drawn, "memory, MB", "Memory: a frame's data (solid), and what the process grew by (dotted)")


def _line(label: str, lines: Sequence[dict], column: str, style: dict) -> list[_Line]:
    """The line of a column of bytes, in MB; nothing if nothing is known."""
    known = [line for line in lines if line.get(column)]
    x, y = (np.array([line[name] for line in known], np.float64) for name in ("ppp", column))
    return [_Line(label, x, y / 1e6, style)] if known else []


def _style(name: str) -> dict:
    ours = name == OURS
    return {"color": COLOURS[name], "marker": MARKERS[name], "markersize": 6 if ours else 4.5,
            "linewidth": 3.0 if ours else 1.6, "zorder": 3 if ours else 2}


def _finish(ax: Axes, lines: Sequence[_Line], label: str, title: str) -> None:
    """Draw the lines, axes and labels."""
    for line in lines:
        ax.plot(line.x, line.y, **line.style)
    ax.set_title(title, size=11, loc="left")
    ax.set(xscale="log", yscale="log", xlabel="photons per pixel (mean, with background)", ylabel=label)
    first, last = min(line.x.min() for line in lines), max(line.x.max() for line in lines)
    ax.set_xlim(first / 1.3, last * 1.3)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
        axis.set_minor_formatter(NullFormatter())
        axis.set_major_formatter(lambda value, _: f"{value:,.0f}" if value >= 1 else f"{value:g}")
    ax.grid(color=_GRID)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    _label_ends(ax, lines)


def _label_ends(ax: Axes, lines: Sequence[_Line]) -> None:
    """Write each label right of its line's end, as near to its height as the others leave it room."""
    to_axes = ax.transData + ax.transAxes.inverted()
    ends = [to_axes.transform((line.x[-1], line.y[-1])) for line in lines]
    heights = np.array(spaced([end[1] for end in ends], _LABEL_GAP))
    heights -= max(heights.max() - _HIGHEST, 0)
    for line, (x, y), height in zip(lines, ends, heights):
        ax.plot([x + 0.005, 1.045], [y, height], transform=ax.transAxes, color=line.style["color"], linewidth=0.7,
                clip_on=False)
        ax.text(1.05, height, line.label, transform=ax.transAxes, va="center", size=9.5, color=line.style["color"],
                weight="bold" if line.label == OURS else "normal", parse_math=False)


def spaced(heights: Sequence[float], gap: float) -> list[float]:
    """Heights of at least `gap` from each other, in the same order, those too close moved apart about their middle."""
    order = np.argsort(heights, kind="stable")
    groups: list[list[float]] = []          # wanted heights of labels that touch
    for height in np.asarray(heights, np.float64)[order]:
        groups.append([height])
        while len(groups) > 1 and _bottom(groups[-1], gap) - _top(groups[-2], gap) < gap:
            last = groups.pop()
            groups[-1] += last
    placed = np.concatenate([_bottom(group, gap) + gap * np.arange(len(group)) for group in groups])
    result = np.empty(len(placed))
    result[order] = placed
    return result.tolist()


def _bottom(group: list[float], gap: float) -> float:
    return float(np.mean(group)) - gap * (len(group) - 1) / 2


def _top(group: list[float], gap: float) -> float:
    return float(np.mean(group)) + gap * (len(group) - 1) / 2
