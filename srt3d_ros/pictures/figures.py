"""Create titled figures and save them as small .png files."""

import base64
import io
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from srt3d_ros.files.new_files import file_errors

DPI = 100
_PALETTE_SIZE = 128


def titled_figure(width_in: float, height_in: float, title: str) -> Figure:
    """An empty figure with a title; $ is not markup."""
    figure = Figure((width_in, height_in), dpi=DPI, layout="constrained")
    figure.suptitle(title, size=13, parse_math=False)
    return figure


def as_image(figure: Figure) -> Image.Image:
    """The figure as an RGB image."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))


def data_uri(image: Image.Image, kind: str, **options) -> str:
    """A picture as a data: URI; `kind` (png, jpeg) and options as for `Image.save`."""
    data = io.BytesIO()
    image.save(data, kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(data.getvalue()).decode()}"


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure with 128 colours, a quarter of the bytes; InvalidInput if that fails."""
    with file_errors("picture", path):
        as_image(figure).quantize(_PALETTE_SIZE, dither=Image.Dither.NONE).save(path, optimize=True)
