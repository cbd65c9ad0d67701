"""Draw metrics against photons per pixel."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from srt3d_ros.pictures.colours import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION
from srt3d_ros.pictures.figures import save_png, titled_figure

METHOD_COLOURS = VERMILION, BLUE, GREEN, BLACK, PURPLE, SKY_BLUE, ORANGE      # markers and dashes differ, too
_STYLES = (("o", "-"), ("v", ":"), ("^", "--"), ("D", (0, (5, 1, 1, 1))), ("P", (0, (1, 1))))
_GRID = "#d9dce0"


@dataclass(frozen=True)
class Metric:
    """A row of panels: a column of the results, and its axis."""

    column: str
    label: str
    scale: str = "linear"       # or "log", or "symlog": linear up to 1, logarithmic above
    limits: tuple[float, float] | None = None


PLOTTED_METRICS = (Metric("true_detections_percent", "true detections, %", limits=(-3, 103)),
           Metric("false_detections_percent", "false detections, %", "symlog", (-0.1, 110)),
           Metric("dae_mm", "depth error (DAE), mm", "log"),
           Metric("iae", "intensity error (IAE), share", "log"))


def draw_metrics(path: Path, rows: Sequence[dict], title: str, methods: Sequence[str]) -> None:
    """Draw the PLOTTED_METRICS of a scene: a column of panels for each SBR, a line for each method and sketch size.

    The panels of a single SBR are in a row.

    Args:
        rows: with `sbr`, `ppp`, `method`, `sketch_size` and the columns of PLOTTED_METRICS.
        methods: all method names; their order gives the colours.
    """
    sbrs = sorted({row["sbr"] for row in rows}, reverse=True)
    panels = len(PLOTTED_METRICS)
    if len(sbrs) > 1:
        figure = titled_figure(3.5 * len(sbrs) + 0.6, 2.3 * panels + 1.2, title)
        axes = figure.subplots(panels, len(sbrs), squeeze=False, sharex="all", sharey="row")
        for ax, sbr in zip(axes[0], sbrs):
            ax.set_title(f"SBR {sbr:g}", size=12)
        lowest = axes[-1]
    else:
        figure = titled_figure(3.5 * panels, 4.2, f"{title}, SBR {sbrs[0]:g}")
        axes = figure.subplots(1, panels, squeeze=False).T
        lowest = axes[:, 0]
    for ax in lowest:
        ax.set_xlabel("photons per pixel, with background")
    lines = _lines(rows, methods)
    for k, sbr in enumerate(sbrs):
        for ax, metric in zip(axes[:, k], PLOTTED_METRICS):
            for _, style, of_line in lines:
                points = sorted((row["ppp"], row[metric.column]) for row in of_line if row["sbr"] == sbr)
                if points:
                    ax.plot(*zip(*points), **style)
            format_axes(ax, metric)
    for ax, metric in zip(axes[:, 0], PLOTTED_METRICS):
        ax.set_ylabel(metric.label)
    handles = [axes[0, 0].plot([], [], label=label, **style)[0] for label, style, _ in lines]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5), frameon=False)
    save_png(figure, path)


def _lines(rows: Sequence[dict], methods: Sequence[str]) -> list[tuple[str, dict, list[dict]]]:
    """(label, style, rows) of each method and sketch size: colour by method, marker by size."""
    sizes = sorted({row["sketch_size"] for row in rows if row["sketch_size"]}, key=lambda m: (m != 10, m))
    lines = []
    for k, method in enumerate(methods):
        for size in (None, *sorted(sizes)):
            chosen = [row for row in rows if row["method"] == method and row["sketch_size"] == size]
            if chosen:
                marker, dashes = _STYLES[sizes.index(size) % len(_STYLES)] if size else ("s", (0, (4, 2)))
                style = {"color": METHOD_COLOURS[k % len(METHOD_COLOURS)], "marker": marker, "linestyle": dashes,
                         "markersize": 4.5, "linewidth": 1.4}
                lines.append((f"{method}, m = {size}" if size else f"{method} (all photons)", style, chosen))
    return lines


def format_axes(ax: Axes, metric: Metric) -> None:
    """Set scales, ticks, limits and grid; x is photons per pixel, logarithmic."""
    ax.set_xscale("log")
    if metric.scale == "log":
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_minor_formatter(NullFormatter())
    elif metric.scale == "symlog":
        ax.set_yscale("symlog", linthresh=1)
        ax.set_yticks([0, 1, 2, 5, 10, 20, 50, 100])
        ax.yaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    if metric.limits is not None:
        ax.set_ylim(*metric.limits)
    ax.grid(color=_GRID)
    ax.set_axisbelow(True)
