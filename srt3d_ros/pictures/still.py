"""A still of one cloud: the cloud, scale bar, colours of the range; with title and figures if it stands alone."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from srt3d_ros.pictures.look import BACKGROUND, Look
from srt3d_ros.pictures.marks import DIM, TEXT, caption, hex_colour, range_bar, scale_bar
from srt3d_ros.viewpoint import Viewpoint

_DPI = 100
_TITLE_PX, _FIGURES_PX = 84, 56         # heights of the bands above and below the cloud


def marked(image: np.ndarray, look: Look, eye: Viewpoint, title: str = "", figures: dict | None = None) -> Image.Image:
    """A drawn cloud with scale bar and range's colours; a title above and figures below make the picture taller.

    Args:
        image: uint8 [height, width, 3], the cloud as `eye` sees it.
        look: gives the colours' ends.
        eye: from where it was drawn.
        title: what it is, and when.
        figures: in order: {"points": 19_871, "latency": "35 ms"}.
    """
    height, width = image.shape[:2]
    above, below = _TITLE_PX * bool(title), _FIGURES_PX * bool(figures)
    total = height + above + below
    figure = Figure((width / _DPI, total / _DPI), dpi=_DPI, facecolor=hex_colour(BACKGROUND))
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, below / total, 1, height / total))
    axes.set_axis_off()
    axes.imshow(image, interpolation="nearest", aspect="auto")
    size = max(width / 100, 9)
    scale_bar(axes, eye, size)
    range_bar(axes, look, size)
    _write(figure, 1 - above / 2 / total, title, 1.9 * size, TEXT, weight="bold")
    _write(figure, below / 2 / total, caption(figures or {}), 1.15 * size, DIM)
    canvas.draw()
    return Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))


def _write(figure: Figure, height: float, text: str, size: float, colour: str, **style) -> None:
    """A line of text, smaller if it is long; a $ in it is a $."""
    size = min(size, figure.get_figwidth() * _DPI / max(len(text), 1))
    figure.text(0.02, height, text, size=size, color=colour, va="center", parse_math=False, **style)
