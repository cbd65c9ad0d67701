"""Plots as SVG, to stand in a page: text and axes take the page's text colour, so dark or light suits."""

import io
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

# Of Okabe and Ito (2008), told apart with any colour vision, and seen on white and on black.
COLOURS = ("#e69f00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9")
_SPAN = "#d55e00"
_PAGE_COLOUR = "#010203"            # stands for the page's text colour
_SIZE_IN, _DPI = (5.2, 2.35), 100
_MOST_PLACES = 600                  # across a plot; of more values, the range at each place is drawn
_MOST_SPANS = 200
_HISTOGRAM_BINS = 60
_PERCENTILES = {50: "median", 95: "95 %"}


def draw_lines(lines: dict[str, tuple[np.ndarray, np.ndarray]], x_label: str, y_label: str,
               spans: Sequence[tuple[float, float]] = ()) -> str:
    """Lines over x, of many values the median at each place within their range; an <svg> element.

    Args:
        lines: x and y by name; values that are not finite are left out.
        x_label, y_label: with units.
        spans: from where to where on x to shade.
    """
    def draw(axes: Axes) -> None:
        for first, last in spans[:_MOST_SPANS]:
            axes.axvspan(first, last, color=_SPAN, alpha=0.3, linewidth=1)
        for (name, (x, y)), colour in zip(lines.items(), COLOURS):
            finite = np.isfinite(y)
            _line(axes, x[finite], y[finite], color=colour, label=name, linewidth=1.3)
        if len(lines) > 1:
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, borderpad=0.1,
                        handlelength=1.2, columnspacing=1.2)
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.margins(x=0.01)
        _set_bottom(axes)
    return _svg(draw)


def draw_histogram(values: np.ndarray, x_label: str, y_label: str, colour: str = COLOURS[0]) -> str:
    """How often each value comes, with median and 95th percentile; an <svg> element."""
    def draw(axes: Axes) -> None:
        axes.hist(values, _HISTOGRAM_BINS, color=colour)
        for percent, name in _PERCENTILES.items():
            at = float(np.percentile(values, percent))
            axes.axvline(at, color=_PAGE_COLOUR, linewidth=1, linestyle=":")
            axes.annotate(f"{name} {_tick(at)}", (at, 1), (0, 3), ("data", "axes fraction"), "offset points", size=9,
                          ha="right" if percent == 50 else "left")
        axes.set(xlabel=x_label, ylabel=y_label)
    return _svg(draw)


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, **style) -> None:
    if len(x) <= 2 * _MOST_PLACES:
        axes.plot(x, y, marker="o" if len(x) < 3 else "", **style)
        return
    parts = np.array_split(np.arange(len(x)), _MOST_PLACES)
    middle = [x[part].mean() for part in parts]
    low, median, high = np.array([np.percentile(y[part], (0, 50, 100)) for part in parts]).T
    axes.fill_between(middle, low, high, color=style["color"], alpha=0.35, linewidth=0)
    axes.plot(middle, median, **style)


def _set_bottom(axes: Axes) -> None:
    """From zero, unless that would hide what changes."""
    low, high = axes.get_ylim()
    if low <= 0 or high - low > 0.3 * high:
        axes.set_ylim(0, max(high, 1e-9) if high > 0.1 else 1)


def _svg(draw: Callable[[Axes], None]) -> str:
    """What draw(axes) makes."""
    ink = dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "grid.color"),
                        _PAGE_COLOUR)
    look = {"svg.fonttype": "none", "font.size": 10, "axes.spines.top": False, "axes.spines.right": False,
            "grid.alpha": 0.18, "axes.grid": True, "axes.axisbelow": True}
    with rc_context(ink | look):
        figure = Figure(_SIZE_IN, dpi=_DPI, layout="constrained")
        axes = figure.add_subplot()
        for patch in (figure.patch, axes.patch):
            patch.set_visible(False)
        draw(axes)
        for axis, most in ((axes.xaxis, 7), (axes.yaxis, 5)):
            axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
            axis.set_major_formatter(lambda value, _: _tick(value))
        text = io.StringIO()
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg[svg.index("<svg"):].replace(_PAGE_COLOUR, "currentColor")


def _tick(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
