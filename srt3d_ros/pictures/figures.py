"""What all figures share: a title, the resolution, and small .png files."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from srt3d_ros.files.new_files import file_errors

DPI = 100
_COLOURS = 128


def titled_figure(width_in: float, height_in: float, title: str) -> Figure:
    """An empty figure with a title, taken literally: $ is not markup."""
    figure = Figure((width_in, height_in), dpi=DPI, layout="constrained")
    figure.suptitle(title, size=13, parse_math=False)
    return figure


def as_image(figure: Figure) -> Image.Image:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure with few colours: a fourth of the bytes, and hardly a difference to see; or InvalidInput."""
    with file_errors("picture", path):
        as_image(figure).quantize(_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
