"""What is written and drawn on dark pictures of clouds: scale bar, colours of the range, captions."""

import numpy as np
from matplotlib.axes import Axes

from srt3d_ros.pictures.look import RANGE_MAP, Look
from srt3d_ros.pictures.raster import focal_px
from srt3d_ros.viewpoint import Viewpoint

TEXT, DIM = "#e8eaed", "#8b939e"
_BAR_SHARE = 0.2                # of the picture's width, that a scale bar takes at most
_RANGE_BAR = 0.16, 0.012        # of the picture's width and height


def scale_bar(axes: Axes, eye: Viewpoint, size: float = 13) -> None:
    """A bar of a round number of metres at the lower right of a picture, as long as it is at the eye's target."""
    height, width = axes.images[0].get_array().shape[:2]
    px_per_m = focal_px(eye, width, height) / np.linalg.norm(eye.target - eye.position)
    exponent = np.floor(np.log10(_BAR_SHARE * width / px_per_m))
    length_m = max(step * 10**exponent for step in (1, 2, 5) if step * 10**exponent * px_per_m <= _BAR_SHARE * width)
    end, line = width - 0.02 * width, height - 0.03 * height
    axes.plot([end - length_m * px_per_m, end], [line, line], color=DIM, linewidth=2, solid_capstyle="butt")
    axes.text(end, line - 0.015 * height, length_text(length_m), color=DIM, size=size, ha="right", va="bottom")


def range_bar(axes: Axes, look: Look, size: float = 13) -> None:
    """The colours of the range at the lower left of a picture, with the metres at their ends."""
    height, width = axes.images[0].get_array().shape[:2]
    wide, tall = _RANGE_BAR[0] * width, _RANGE_BAR[1] * height
    left, bottom = 0.02 * width, height - 0.03 * height
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(RANGE_MAP[None] / 255, extent=(left, left + wide, bottom, bottom - tall), aspect="auto", zorder=3)
    axes.set(xlim=limits[0], ylim=limits[1])
    ends = (left, look.near_m, "left"), (left + wide, look.far_m, "right")
    for x, metres, side in ends:
        axes.text(x, bottom - tall - 0.012 * height, f"{metres:.3g} m", color=DIM, size=size, ha=side, va="bottom")


def length_text(length_m: float) -> str:
    """A length in the unit that makes it short: 2 m, 50 cm, 5 mm."""
    if length_m >= 1:
        return f"{length_m:g} m"
    return f"{length_m * 100:g} cm" if length_m >= 0.01 else f"{length_m * 1000:g} mm"


def caption(figures: dict) -> str:
    """Figures in one line: {"points": 19_871, "latency": "35 ms"}."""
    return "     ".join(f"{name}: {number(value)}" for name, value in figures.items())


def number(value) -> str:
    """A figure as text: 19,871; 0.569; texts as they are."""
    if isinstance(value, (int, np.integer)):
        return f"{value:,}"
    return f"{value:.3g}" if isinstance(value, (float, np.floating)) else str(value)


def hex_colour(colour: tuple[int, int, int]) -> str:
    """#rrggbb."""
    return "#" + bytes(colour).hex()
