"""Reconstructions side by side: clouds of the same scene by several methods, and maps of their errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from srt3d_ros.colours import BACKGROUND
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.pictures.cloud_renderer import CloudStyle, draw_surface
from srt3d_ros.pictures.figures import save_png, titled_figure
from srt3d_ros.pictures.viewpoint import look_at

_PANEL_IN, _ROW_IN, _TITLE_IN, _SCALE_IN = 2.5, 3.2, 0.4, 0.9
_CLOUD_PX = 480                 # side of a drawn cloud, which matplotlib makes smaller: smooth edges
_NO_POINT, _NO_REFERENCE = (0.0, 0.0, 0.0), (0.72, 0.72, 0.72)
_ERROR_MAP = "RdBu_r"           # distinct ends for any colour vision


@dataclass(frozen=True, eq=False)
class Panel:
    """One cloud: `heading` names the method, `caption` gives the figures of merit."""

    heading: str
    cloud: PointCloud
    caption: str
    error_mm: np.ndarray | None = None      # float [rows, cols], of the strongest points, NaN = none; None: the truth


@dataclass(frozen=True, eq=False)
class Strip:
    """A row of panels: one observation. The first panel (the truth if it is known) sets viewpoint and colours."""

    label: str
    sensor: SensorModel
    panels: Sequence[Panel]
    known: np.ndarray | None = None         # bool [rows, cols]: the truth is known


def draw_clouds(path: Path, strips: Sequence[Strip], title: str) -> None:
    """Draw the clouds, one viewpoint for each row, coloured by range, shaded by intensity."""
    _draw(path, strips, title, [_cloud_images(strip) for strip in strips])


def draw_errors(path: Path, strips: Sequence[Strip], title: str) -> None:
    """Draw maps of the depth error in millimetres, one scale for each row, of all panels but the truth."""
    strips = [replace(strip, panels=[panel for panel in strip.panels if panel.error_mm is not None])
              for strip in strips]
    strips = [strip for strip in strips if strip.panels]
    if strips:
        scales_mm = [_error_scale(strip) for strip in strips]
        _draw(path, strips, title, [_error_images(strip, scale_mm) for strip, scale_mm in zip(strips, scales_mm)],
              scales_mm)


def _cloud_images(strip: Strip) -> list[np.ndarray]:
    first = strip.panels[0].cloud
    style, eye = CloudStyle.of(first, strip.sensor), look_at(first.xyz, strip.sensor.projection)
    return [draw_surface(panel.cloud.xyz, style.shaded(panel.cloud), eye, _CLOUD_PX, _CLOUD_PX, style.radius_m,
                         BACKGROUND) for panel in strip.panels]


def _error_scale(strip: Strip) -> float:
    """Error in mm at the ends of the colours: 4 × the best panel's median error, rounded up to 1, 2, 5 · 10ⁿ."""
    medians = [float(np.nanmedian(np.abs(panel.error_mm))) for panel in strip.panels
               if np.isfinite(panel.error_mm).any()]
    wanted = max(4 * min(medians, default=1.0), 1e-6)
    step = 10.0 ** np.floor(np.log10(wanted))
    return next(float(step * factor) for factor in (1, 2, 5, 10) if step * factor >= wanted)


def _error_images(strip: Strip, scale_mm: float) -> list[np.ndarray]:
    images = []
    for panel in strip.panels:
        image = colormaps[_ERROR_MAP](Normalize(-scale_mm, scale_mm)(panel.error_mm))[..., :3]
        image[~np.isfinite(panel.error_mm)] = _NO_POINT
        image[~strip.known] = _NO_REFERENCE
        images.append(image)
    return images


def _draw(path: Path, strips: Sequence[Strip], title: str, images: Sequence[Sequence[np.ndarray]],
          scales_mm: Sequence[float] = ()) -> None:
    """Draw a row of images for each strip, and a colour bar for each scale."""
    columns = max(len(strip.panels) for strip in strips)
    figure = titled_figure(_PANEL_IN * max(columns, 2) + _SCALE_IN * bool(scales_mm),
                           _ROW_IN * len(strips) + _TITLE_IN, title)
    rows = figure.subfigures(len(strips), 1, squeeze=False)[:, 0]
    for k, (row, strip) in enumerate(zip(rows, strips)):
        row.suptitle(strip.label, x=0.01, ha="left", size=11, weight="bold", parse_math=False)
        all_axes = row.subplots(1, columns, squeeze=False)[0]
        for axes in all_axes:
            axes.set_axis_off()
        for axes, panel, image in zip(all_axes, strip.panels, images[k]):
            axes.imshow(image, interpolation="nearest" if scales_mm else None)
            axes.set_title(panel.heading, loc="left", size=10, parse_math=False)
            axes.text(0, -0.03, panel.caption, transform=axes.transAxes, va="top", size=8.5, parse_math=False)
        if scales_mm:
            scale = ScalarMappable(Normalize(-scales_mm[k], scales_mm[k]), colormaps[_ERROR_MAP])
            row.colorbar(scale, ax=all_axes, extend="both", extendfrac=0.03, label="depth error, mm")
    save_png(figure, path)
