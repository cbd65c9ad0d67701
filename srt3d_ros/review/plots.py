"""Plots of a recording as SVG, with text and axes in the page's text colour, for dark and light pages."""

import io
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from srt3d_ros.pictures.colours import BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION
from srt3d_ros.pictures.figures import DPI
from srt3d_ros.pictures.units import number_text
from srt3d_ros.recording.reader import Series
from srt3d_ros.review.recorded import Recorded

TIME = "seconds since the first cloud"
_LINE_COLOURS, _GAP_COLOUR = (ORANGE, BLUE, GREEN, PURPLE, SKY_BLUE), VERMILION
_PAGE_COLOUR = "#010203"            # placeholder of the page's text colour
_COLOURED = "text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "grid.color"
_STYLE: dict[Any, Any] = dict.fromkeys(_COLOURED, _PAGE_COLOUR) | {
    "svg.fonttype": "none", "font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "grid.alpha": 0.18,
    "axes.grid": True, "axes.axisbelow": True}
_SIZE_IN = (5.2, 2.35)
_MOST_PARTS = 600                   # of a line, about its width in pixels
_SHADED_GAPS = 10                   # the longest


def draw_plots(recorded: Recorded) -> list[tuple[str, str]]:
    """(title, <svg> element) of each plot with values; gaps are shaded."""
    plots = [("Latency", "latency, ms", {stage.replace("total", "end to end"): series
                                         for stage, series in recorded.latencies().items()}),
             ("Points a frame", "points", {"points": Series(recorded.index.stamp_ns, recorded.index.points)})]
    plots += [(title, label, {name: recorded.series[name]})
              for name, title, label in (("photons", "Photons a frame", "photons"),
                                         ("frame_rate_hz", "Frame rate", "frames a second")) if name in recorded.series]
    return [(title, _svg(recorded, lines, label)) for title, label, lines in plots if lines]


def _svg(recorded: Recorded, lines: dict[str, Series], label: str) -> str:
    """The <svg> element with lines, without NaN and Inf, and with shaded gaps."""
    with rc_context(_STYLE):
        figure = Figure(_SIZE_IN, dpi=DPI, layout="constrained")
        axes = figure.add_subplot()
        for patch in (figure.patch, axes.patch):
            patch.set_visible(False)
        for gap in recorded.gaps[:_SHADED_GAPS]:
            axes.axvspan(*recorded.seconds[[gap, gap + 1]], color=_GAP_COLOUR, alpha=0.3, linewidth=1)
        for (name, series), colour in zip(lines.items(), _LINE_COLOURS):
            shown = extremes(series.values)
            axes.plot(recorded.since_first(series.stamp_ns[shown]), series.values[shown], color=colour, label=name,
                      linewidth=1.3, marker="o" if len(shown) < 3 else "")
        if len(lines) > 1:
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, borderpad=0.1,
                        handlelength=1.2, columnspacing=1.2)
        axes.set(xlabel=TIME, ylabel=label)
        axes.margins(x=0.01)
        low, high = axes.get_ylim()
        # Start at 0, unless that hides changes of 1 % or more; smaller ones would look large.
        if low <= 0 or not 0.01 * high < high - low < 0.3 * high:
            axes.set_ylim(0, 1.05 * max(high, 1e-9) if high > 0.1 else 1)
        for axis, most in ((axes.xaxis, 7), (axes.yaxis, 5)):
            axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
            axis.set_major_formatter(lambda value, _: number_text(value, 4))
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg[svg.index("<svg"):].replace(_PAGE_COLOUR, "currentColor")


def extremes(values: np.ndarray) -> np.ndarray:
    """Positions of the finite values; of many, those of the least and the greatest in each of _MOST_PARTS parts."""
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= 2 * _MOST_PARTS:
        return finite
    return np.array([at for part in np.array_split(finite, _MOST_PARTS)
                     for at in sorted((part[values[part].argmin()], part[values[part].argmax()]))])
