"""Figures as small .png files."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

_COLOURS = 128


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure with few colours: a fourth of the bytes, and hardly a difference to see."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    picture.quantize(_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
