"""Reconstructions side by side: clouds of the same scene by several methods, and maps of their errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.png import save_png
from srt3d_ros.viewpoint import look_at

DPI = 100
# Picture elements: side of an image, gap, margin, height of the title, offset of the images in a row, height of a row.
_SIDE_PX, _GAP_PX, _EDGE_PX, _TITLE_PX, _IMAGE_PX, _ROW_PX = 240, 8, 14, 40, 44, 318
_SCALE_PX, _LEAST_WIDTH_PX = 84, 640
_NO_POINT, _NO_REFERENCE = (0.0, 0.0, 0.0), (0.72, 0.72, 0.72)
_ERROR_MAP = "RdBu_r"           # distinct ends for any colour vision


@dataclass(frozen=True, eq=False)
class Panel:
    """One cloud.

    Args:
        heading: the method.
        caption: the figures of merit.
        error_mm: float [rows, cols], depth error of the strongest point, NaN = no point; None for the truth.
    """

    heading: str
    cloud: PointCloud
    caption: str
    error_mm: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Strip:
    """A row of panels: one observation.

    Args:
        label: of the observation.
        sensor: its sensor.
        panels: the first one (the truth if it is known) sets viewpoint and colours.
        known: bool [rows, cols], pixels whose truth is known.
    """

    label: str
    sensor: SensorModel
    panels: Sequence[Panel]
    known: np.ndarray | None = None


def draw_clouds(path: Path, strips: Sequence[Strip], title: str) -> None:
    """Draw the clouds, one viewpoint for each row, coloured by range, shaded by intensity."""
    def prepared(strip: Strip) -> Callable[[Panel], np.ndarray]:
        first = strip.panels[0].cloud
        style, eye = CloudStyle.of(first, strip.sensor), look_at(first.xyz, strip.sensor.projection)
        return lambda panel: style.draw(panel.cloud, eye, _SIDE_PX, _SIDE_PX)

    _draw(path, strips, title, prepared)


def draw_errors(path: Path, strips: Sequence[Strip], title: str) -> None:
    """Draw maps of the depth error in millimetres, one scale for each row, of all panels but the truth."""
    strips = [replace(strip, panels=[panel for panel in strip.panels if panel.error_mm is not None])
              for strip in strips]
    strips = [strip for strip in strips if strip.panels]
    if strips:
        scales = {strip: _error_scale(strip) for strip in strips}
        _draw(path, strips, title, lambda strip: lambda panel: _error_image(panel, strip, scales[strip]),
              list(scales.values()))


def _error_scale(strip: Strip) -> float:
    """Error in mm at the ends of the colours: 4 × the best panel's median error, rounded up to 1, 2, 5 · 10ⁿ."""
    medians = [float(np.nanmedian(np.abs(panel.error_mm))) for panel in strip.panels
               if np.isfinite(panel.error_mm).any()]
    wanted = max(4 * min(medians, default=1.0), 1e-6)
    step = 10.0 ** np.floor(np.log10(wanted))
    return next(float(step * factor) for factor in (1, 2, 5, 10) if step * factor >= wanted)


def _error_image(panel: Panel, strip: Strip, scale_mm: float) -> np.ndarray:
    image = colormaps[_ERROR_MAP](Normalize(-scale_mm, scale_mm)(panel.error_mm))[..., :3]
    image[~np.isfinite(panel.error_mm)] = _NO_POINT
    image[~strip.known] = _NO_REFERENCE
    return image


def _draw(path: Path, strips: Sequence[Strip], title: str, prepared: Callable, scales_mm: Sequence[float] = ()) -> None:
    """Draw a grid of images: headings above, captions below, labels of the rows, and a colour bar for each scale."""
    columns = max(len(strip.panels) for strip in strips)
    page = _Page(max(_EDGE_PX + columns * (_SIDE_PX + _GAP_PX) + (_SCALE_PX if scales_mm else _EDGE_PX - _GAP_PX),
                     _LEAST_WIDTH_PX), _TITLE_PX + len(strips) * _ROW_PX)
    page.text(_EDGE_PX, 18, title, 13)
    for r, strip in enumerate(strips):
        top, draw = _TITLE_PX + r * _ROW_PX, prepared(strip)
        page.text(_EDGE_PX, top + 10, strip.label, 11, weight="bold")
        for c, panel in enumerate(strip.panels):
            left = _EDGE_PX + c * (_SIDE_PX + _GAP_PX)
            page.text(left, top + 32, panel.heading, 10)
            page.axes(left, top + _IMAGE_PX, _SIDE_PX).imshow(draw(panel), interpolation="nearest", aspect="equal")
            page.text(left, top + _IMAGE_PX + _SIDE_PX + 11, panel.caption, 8.5)
        if scales_mm:
            left = _EDGE_PX + len(strip.panels) * (_SIDE_PX + _GAP_PX)
            _scale(page.figure, scales_mm[r], page.axes(left, top + _IMAGE_PX, 12, _SIDE_PX))
    save_png(page.figure, path)


class _Page:
    """A figure with positions in picture elements from its upper left corner."""

    def __init__(self, width: int, height: int):
        self._size = (width, height)
        self.figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")

    def text(self, left: int, middle: int, text: str, size: float, **style) -> None:
        width, height = self._size
        self.figure.text(left / width, 1 - middle / height, text, size=size, va="center", parse_math=False, **style)

    def axes(self, left: int, top: int, side: int, tall: int | None = None):
        width, height = self._size
        tall = side if tall is None else tall
        axes = self.figure.add_axes((left / width, 1 - (top + tall) / height, side / width, tall / height))
        axes.set_axis_off()
        return axes


def _scale(figure: Figure, scale_mm: float, axes) -> None:
    axes.set_axis_on()
    bar = figure.colorbar(ScalarMappable(Normalize(-scale_mm, scale_mm), colormaps[_ERROR_MAP]), cax=axes,
                          extend="both", extendfrac=0.03)
    bar.set_label("depth error, mm", size=9)
    axes.tick_params(labelsize=8)
