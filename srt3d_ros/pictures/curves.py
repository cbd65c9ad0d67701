"""Curves: metrics, times and memory against photons per pixel, and observed against nominal shares of errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, Locator, LogLocator, NullFormatter, NullLocator

from srt3d_ros.pictures.figures import save_png, titled_figure

# Okabe and Ito's colours (2008), distinct for any colour vision. Markers and dashes differ as well.
METHOD_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#000000", "#cc79a7", "#56b4e9", "#e69f00")
_STYLES = (("o", "-"), ("v", ":"), ("^", "--"), ("D", (0, (5, 1, 1, 1))), ("P", (0, (1, 1))))
# The same of each method in `draw_growth`, and its marker; only our line is thick.
GROWTH_STYLES = {"pooled": ("#d55e00", "o"), "srt3d": ("#0072b2", "s"), "smle": ("#009e73", "^"),
                 "xcorr": ("#000000", "D"), "rt3d": ("#a0527f", "v"), "sketching": ("#8a8f98", ".")}
_OURS = "pooled"
_TIME_LABELS = {"sketching": "sketching, while photons come", "rt3d": "rt3d (all photons)",
                "xcorr": "xcorr (histograms)"}
_INPUT_LABELS = {"rt3d": "photons, for rt3d", "xcorr": "histograms, for xcorr", "pooled": "sketch, for the others"}
# By the order of the representations in `draw_bytes`.
_BYTES_STYLES = tuple(zip((*METHOD_COLOURS, "#8a8f98", "#7a4a00"), "osv^DPX*<"))
_BYTES_DASHES = {"pooled": "-", "pixel": (0, (1, 1.5)), "3 × 3": (0, (4, 2))}
_PANELS_IN_ROW = 4
_CUT_OFF = 15           # times the least error of a panel
_GRID, _GOAL, _GOAL_LINE = "#d9dce0", "#b8bec6", "#6b7280"
# Lighter and warmer along a series.
_SERIES_MAP = LinearSegmentedColormap.from_list(
    "series", [(0, 0.2, 0.45), (0, 0.5, 0.6), (0.55, 0.6, 0.3), (0.9, 0.5, 0.0)])


@dataclass(frozen=True)
class Metric:
    """A row of panels: a column of the results, the label and limits of its axis."""

    column: str
    label: str
    scale: str = "linear"       # or log, or symlog: linear up to 1, logarithmic above
    limits: tuple[float, float] | None = None


METRICS = (Metric("true_detections_percent", "true detections, %", limits=(-3, 103)),
           Metric("false_detections_percent", "false detections, %", "symlog", (-0.1, 110)),
           Metric("dae_mm", "depth error (DAE), mm", "log"),
           Metric("iae", "intensity error (IAE), share", "log"))


def draw_metrics(path: Path, rows: Sequence[dict], title: str, methods: Sequence[str]) -> None:
    """Draw the METRICS of one scene against photons per pixel.

    There is a column of panels for each SBR and a line for each method and sketch size.

    Args:
        rows: with `sbr`, `ppp`, `method`, `sketch_size` and the columns of METRICS.
        methods: all names, whose order gives the colours.
    """
    sbrs = sorted({float(row["sbr"]) for row in rows}, reverse=True)
    figure, axes = _figure(len(METRICS), len(sbrs), 3.5, 2.3, title)
    lines = _lines(rows, methods)
    for k, sbr in enumerate(sbrs):
        axes[0, k].set_title(f"SBR {sbr:g}", size=12)
        axes[-1, k].set_xlabel("photons per pixel (mean, with background)")
        for ax, metric in zip(axes[:, k], METRICS):
            for _, style, of_line in lines:
                points = sorted((float(row["ppp"]), float(row[metric.column])) for row in of_line
                                if float(row["sbr"]) == sbr)
                if points:
                    ax.plot(*zip(*points), **style)
            _format_axes(ax, metric)
    for ax, metric in zip(axes[:, 0], METRICS):
        ax.set_ylabel(metric.label)
    handles = [axes[0, 0].plot([], [], label=label, **style)[0] for label, style, _ in lines]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5), frameon=False)
    save_png(figure, path)


def draw_calibration(path: Path, curves: dict[str, dict[str, Sequence[float]]], nominal: Sequence[float],
                     goals: dict[float, tuple[float, float]], title: str) -> None:
    """Draw the observed share of errors within k standard deviations against the share of a normal distribution.

    Args:
        curves: for each panel (its heading), for each line (its label), the observed shares in percent.
        nominal: the shares of the normal distribution, 0 … 1.
        goals: for some nominal shares, the range aimed at.
    """
    figure, axes = _figure(1, len(curves), 4.2, 4.4, title)
    nominal_percent = 100 * np.array(nominal)
    for ax, (heading, lines) in zip(axes[0], curves.items()):
        ax.plot([0, 100], [0, 100], color=_GOAL, linewidth=1.5, label="as it should be")
        for share, (low, high) in goals.items():
            ax.plot([100 * share] * 2, [100 * low, 100 * high], color=_GOAL, linewidth=7, solid_capstyle="butt")
        shades = np.linspace(0.0, 1.0, max(len(lines), 2))
        for (label, observed), shade, (marker, _) in zip(lines.items(), shades, _STYLES * 9):
            ax.plot(nominal_percent, observed, marker=marker, markersize=5, color=_SERIES_MAP(shade), label=label)
        ax.set(title=heading, xlim=(0, 101), ylim=(0, 101), xlabel="nominal share, %")
        _grid(ax)
        ax.legend(loc="upper left", fontsize=8.5, framealpha=0.85)
    axes[0, 0].set_ylabel("observed share of depth errors, %")
    save_png(figure, path)


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
    figure = titled_figure(14.2, 6.0, title)
    methods = {line["method"] for line in lines}
    by_method = {name: [line for line in lines if line["method"] == name] for name in GROWTH_STYLES if name in methods}
    time_ax, memory_ax = figure.subplots(1, 2)
    _draw_times(time_ax, by_method, goal, stopped)
    _draw_memory(memory_ax, by_method)
    save_png(figure, path)


def draw_bytes(path: Path, lines: Sequence[dict], representations: Sequence[str], budgets: Sequence[int]) -> None:
    """Draw a panel for each case: the least error that so many bytes a pixel give, on logarithmic axes.

    Errors above _CUT_OFF times the least are cut off.

    Args:
        lines: with `case`, `representation`, `reconstruction`, `bytes_per_pixel` and `error_bins`.
        representations: all names; the first one is ours.
        budgets: bytes a pixel to mark.
    """
    cases = list(dict.fromkeys(line["case"] for line in lines))
    cols = min(len(cases), _PANELS_IN_ROW)
    figure = titled_figure(max(3.9 * cols + 0.6, 9), 3.3 * -(-len(cases) // cols) + 1.4,
                           "Depth error in equal bytes: pooled along surfaces, or each pixel alone")
    axes = figure.subplots(-(-len(cases) // cols), cols, squeeze=False).ravel()
    for ax, case in zip(axes, cases):
        for budget in budgets:
            ax.axvline(budget, color=_GOAL, linewidth=0.8)
        for name, (colour, marker) in zip(representations, _BYTES_STYLES):
            for how, dashes in _BYTES_DASHES.items():
                points = sorted((line["bytes_per_pixel"], line["error_bins"]) for line in lines if (
                    line["case"], line["representation"], line["reconstruction"]) == (case, name, how))
                if points:
                    size, error = np.array(points).T
                    alone = how == "pixel"
                    ax.plot(size, np.minimum.accumulate(error), color=colour, linestyle=dashes,
                            marker=None if alone and len(size) > 1 else marker, markersize=4, zorder=2 if alone else 3,
                            linewidth=2.6 if name == representations[0] and not alone else 1.2)
        ppp = next(line["photons_per_pixel"] for line in lines if line["case"] == case)
        ax.set_title(f"{case} ({ppp:.3g} photons)" if "ppp" not in case else case, size=10)
        errors = [line["error_bins"] for line in lines if line["case"] == case]
        ax.set(xscale="log", yscale="log", ylim=(0.85 * min(errors), 1.15 * min(max(errors), _CUT_OFF * min(errors))))
        _ticks(ax.xaxis, LogLocator(subs=(1, 2, 5)))
        _ticks(ax.yaxis, LogLocator(subs=(1, 2, 5)))
        _grid(ax)
    for ax in axes[len(cases):]:
        ax.set_axis_off()
    figure.supylabel("mean depth error, bins; of a missed surface the tolerance", size=10)
    for ax in axes[max(len(cases) - cols, 0):len(cases)]:
        ax.set_xlabel("bytes a pixel")
    handles = [axes[0].plot([], [], color=colour, marker=marker, label=name)[0]
               for name, (colour, marker) in zip(representations, _BYTES_STYLES)]
    handles += [axes[0].plot([], [], color=_GOAL_LINE, linestyle=dashes, label=how)[0]
                for how, dashes in _BYTES_DASHES.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(2 * cols + 2, 6), frameon=False)
    save_png(figure, path)


def _lines(rows: Sequence[dict], methods: Sequence[str]) -> list[tuple[str, dict, list[dict]]]:
    """(label, style, rows) of each method and sketch size: its colour is the method's, its marker the size's."""
    sizes = sorted({int(row["sketch_size"]) for row in rows if row["sketch_size"]}, key=lambda m: (m != 10, m))
    lines = []
    for k, method in enumerate(methods):
        for size in ("", *sorted(sizes)):
            chosen = [row for row in rows if row["method"] == method and row["sketch_size"] == str(size)]
            if chosen:
                marker, dashes = _STYLES[sizes.index(size) % len(_STYLES)] if size else ("s", (0, (4, 2)))
                style = {"color": METHOD_COLOURS[k % len(METHOD_COLOURS)], "marker": marker, "linestyle": dashes,
                         "markersize": 4.5, "linewidth": 1.4}
                lines.append((f"{method}, m = {size}" if size else f"{method} (all photons)", style, chosen))
    return lines


def _figure(rows: int, cols: int, width_in: float, height_in: float, title: str) -> tuple[Figure, np.ndarray]:
    figure = titled_figure(width_in * cols + 0.6, height_in * rows + 1.2, title)
    return figure, figure.subplots(rows, cols, squeeze=False, sharex="all", sharey="row")


def _format_axes(ax: Axes, metric: Metric) -> None:
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    if metric.scale == "log":
        ax.set_yscale("log")
        _ticks(ax.yaxis, LogLocator(subs=(1, 2, 5)))
    elif metric.scale == "symlog":
        ax.set_yscale("symlog", linthresh=1)
        _ticks(ax.yaxis, FixedLocator([0, 1, 2, 5, 10, 20, 50, 100]))
        ax.yaxis.set_minor_locator(NullLocator())
    if metric.limits is not None:
        ax.set_ylim(*metric.limits)
    _grid(ax)


def _draw_times(ax: Axes, by_method: dict[str, list[dict]], goal: tuple[float, str] | None,
                stopped: dict[str, str]) -> None:
    for name, lines in by_method.items():
        x = [line["ppp"] for line in lines]
        low, median, high = ([line["ms"][which] for line in lines] for which in ("min", "median", "max"))
        ax.fill_between(x, low, high, color=GROWTH_STYLES[name][0], alpha=0.18, linewidth=0)
        label = f"{_TIME_LABELS.get(name, name)}{': ' * (name in stopped)}{stopped.get(name, '')}"
        ax.plot(x, median, label=label, **_growth_style(name) | {"linestyle": "--" if name == "sketching" else "-"})
    drawn = list(ax.get_lines())
    if goal is not None:
        ax.axhline(goal[0], color=_GOAL_LINE, linewidth=1.5, linestyle=(0, (6, 3)))
        ax.annotate(goal[1], (0.01, goal[0]), (0, -3), ("axes fraction", "data"), "offset points", va="top", size=9,
                    color=_GOAL_LINE, bbox={"color": "white", "alpha": 0.8, "pad": 0.5}, zorder=4)
    _format_growth_axes(ax, drawn, "time of a frame, ms", "Time: from a sketch, or all photons, to the cloud")


def _draw_memory(ax: Axes, by_method: dict[str, list[dict]]) -> None:
    dotted = {"linestyle": ":", "linewidth": 1.3, "markersize": 3}
    for name, lines in by_method.items():
        for column, label, style in (("input_bytes", _INPUT_LABELS.get(name), {}),
                                     ("growth_bytes", f"{name}, working" if name != "sketching" else None, dotted)):
            known = [(line["ppp"], line[column] / 1e6) for line in lines if line.get(column)]
            if label and known:
                ax.plot(*zip(*known), label=label, **_growth_style(name) | style)
    _format_growth_axes(ax, ax.get_lines(), "memory, MB",
                        "Memory: a frame's data (solid), and what the process grew by (dotted)")


def _growth_style(name: str) -> dict:
    colour, marker = GROWTH_STYLES[name]
    ours = name == _OURS
    return {"color": colour, "marker": marker, "markersize": 6 if ours else 4.5,
            "linewidth": 3.0 if ours else 1.6, "zorder": 3 if ours else 2}


def _format_growth_axes(ax: Axes, lines: Sequence[Line2D], label: str, title: str) -> None:
    ax.set_title(title, size=11, loc="left")
    ax.set(xscale="log", yscale="log", xlabel="photons per pixel (mean, with background)", ylabel=label)
    for axis in (ax.xaxis, ax.yaxis):
        _ticks(axis, LogLocator(numticks=12), lambda value, _: f"{value:,.0f}" if value >= 1 else f"{value:g}")
    _grid(ax)
    ax.spines[["top", "right"]].set_visible(False)
    lines = sorted(lines, key=lambda line: line.get_ydata()[-1], reverse=True)         # as their ends are
    ax.legend(handles=lines, loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=9.5)


def _ticks(axis: Axis, locator: Locator, text="{x:g}") -> None:
    axis.set_major_locator(locator)
    axis.set_major_formatter(text)
    axis.set_minor_formatter(NullFormatter())


def _grid(ax: Axes) -> None:
    ax.grid(color=_GRID)
    ax.set_axisbelow(True)
