"""Draw texts, scale bars and colour bars on dark pictures of clouds."""

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.pictures.cloud_renderer import CloudStyle, focal_px
from srt3d_ros.pictures.colours import BACKGROUND
from srt3d_ros.pictures.figures import DPI, as_image
from srt3d_ros.pictures.quantities import RANGE
from srt3d_ros.pictures.units import length_text
from srt3d_ros.pictures.viewpoint import Viewpoint, look_at

TEXT_COLOUR, DIM_COLOUR = "#e8eaed", "#8b939e"
BEHIND = tuple(np.divide(BACKGROUND, 255))      # in matplotlib's form
_BAR_SHARE = 0.2                        # longest scale bar over the picture's width
_RANGE_BAR = 0.16, 0.012                # width and height over the picture's
_RANGE_BAR_PX_PER_PT = 12               # least width: the numbers at its ends, of this size, need room
_LETTER_PX_PER_PT = 0.85                # width of a letter
_BACKING = [withStroke(linewidth=4, foreground=BEHIND)]       # of texts and lines that may lie on points
_TEXT: dict[str, Any] = {"color": TEXT_COLOUR, "va": "bottom", "path_effects": _BACKING}


def dark_figure(width_px: int, height_px: int) -> Figure:
    """A figure of this size with the dark background of clouds."""
    return Figure((width_px / DPI, height_px / DPI), dpi=DPI, facecolor=BEHIND)


def image_axes(figure: Figure, box: tuple[float, float, float, float], image: np.ndarray,
               aspect: Literal["auto", "equal"] = "auto") -> Axes:
    """Axes at (left, bottom, width, height) of the figure, which an image fills; if `equal`, as far as it fits."""
    axes = figure.add_axes(box, anchor="W")
    axes.set_axis_off()
    axes.imshow(image, interpolation="nearest", aspect=aspect)
    return axes


def filled_figure(image: np.ndarray) -> tuple[Figure, Axes]:
    """A figure that an image [height, width, 3] fills, and its axes, in pixels, to draw over it."""
    figure = dark_figure(*image.shape[1::-1])
    axes = image_axes(figure, (0, 0, 1, 1), image)
    axes.autoscale(False)
    return figure, axes


def write_line(figure: Figure, height: float, text: str, size: float, colour: str, **style: Any) -> None:
    """Write a line of text, smaller if it is too long for the figure; $ is not markup."""
    size = min(size, figure.get_figwidth() * DPI / max(len(text), 1))
    figure.text(0.02, height, text, size=size, color=colour, va="center", parse_math=False, **style)


def scale_bar(axes: Axes, eye: Viewpoint, size: float = 13) -> None:
    """Draw a bar of 1, 2 or 5 · 10ⁿ metres, measured at the eye's target, at the lower right."""
    height, width = axes.images[0].get_size()
    px_per_m = focal_px(eye, width, height) / np.linalg.norm(eye.target - eye.position)
    exponent = np.floor(np.log10(_BAR_SHARE * width / px_per_m))
    length_m = max(step * 10**exponent for step in (1, 2, 5) if step * 10**exponent * px_per_m <= _BAR_SHARE * width)
    end, line = width - 0.02 * width, height - 0.03 * height
    axes.plot([end - length_m * px_per_m, end], [line, line], color=TEXT_COLOUR, linewidth=2, solid_capstyle="butt",
              path_effects=_BACKING)
    axes.text(end, line - 0.015 * height, length_text(length_m), size=size, ha="right", **_TEXT)


def range_bar(axes: Axes, style: CloudStyle, size: float = 13, finer: int = 1) -> None:
    """Draw the colours with the values at their ends, at the lower left; their name above unless it is the range.

    `finer` are the pixels of the image in one of the figure.
    """
    (share, height), quantity = _RANGE_BAR, style.quantity
    ends = [quantity.text(end) for end in style.ends]
    letters = max(_RANGE_BAR_PX_PER_PT, _LETTER_PX_PER_PT * sum(map(len, ends)))
    share = max(share, letters * size * finer / axes.images[0].get_size()[1])
    bar = axes.inset_axes((0.02, 0.03, share, height))
    bar.set_axis_off()
    bar.imshow(quantity.table[None], aspect="auto")
    style_of_text = {"transform": bar.transAxes, "size": size, **_TEXT}
    bar.text(0, 2, ends[0], ha="left", **style_of_text)
    bar.text(1, 2, ends[1], ha="right", **style_of_text)
    if quantity is not RANGE:
        bar.text(0, 4.5, quantity.label, ha="left", **style_of_text)


def annotated(image: np.ndarray, style: CloudStyle, eye: Viewpoint) -> Image.Image:
    """A picture of a cloud, uint8 [height, width, 3] seen from `eye`, with scale bar and colour bar."""
    (figure, axes), size = filled_figure(image), max(image.shape[1] / 100, 9)
    scale_bar(axes, eye, size)
    range_bar(axes, style, size)
    return as_image(figure)


def draw_cloud(cloud: PointCloud, yaw_deg: float = 15, pitch_deg: float = 10, size_px: tuple[int, int] = (1200, 900),
               colour_by: str = "range") -> Image.Image:
    """A cloud with scale bar, coloured by a quantity; by range it is shaded by intensity, too."""
    width, height = size_px
    eye = look_at(cloud.xyz, cloud.sensor.projection, yaw_deg, pitch_deg, aspect=width / height)
    style = CloudStyle.of(cloud, cloud.sensor, colour_by)
    return annotated(style.draw(cloud, eye, width, height), style, eye)
