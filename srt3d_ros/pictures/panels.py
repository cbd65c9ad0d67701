"""Draw clouds of the same scene by several methods side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.pictures.cloud_renderer import CloudStyle, draw_surface
from srt3d_ros.pictures.colours import BACKGROUND
from srt3d_ros.pictures.figures import save_png, titled_figure
from srt3d_ros.pictures.viewpoint import look_at

_PANEL_IN, _ROW_IN, _TITLE_IN = 2.5, 3.2, 0.4
_CLOUD_PX = 480                 # side of a drawn cloud; matplotlib shrinks it, which smooths edges


class Panel(NamedTuple):
    """One cloud, with the method's name as heading and its metrics as caption."""

    heading: str
    cloud: PointCloud
    caption: str


class Strip(NamedTuple):
    """A row of panels for one observation. The first panel (the truth if known) sets viewpoint and colours."""

    label: str
    sensor: SensorModel
    panels: Sequence[Panel]


def draw_clouds(path: Path, strips: Sequence[Strip], title: str) -> None:
    """Draw clouds coloured by range and shaded by intensity, with one viewpoint a row."""
    columns = max(len(strip.panels) for strip in strips)
    figure = titled_figure(_PANEL_IN * max(columns, 2), _ROW_IN * len(strips) + _TITLE_IN, title)
    for row, strip in zip(figure.subfigures(len(strips), 1, squeeze=False)[:, 0], strips):
        row.suptitle(strip.label, x=0.01, ha="left", size=11, weight="bold", parse_math=False)
        all_axes = row.subplots(1, columns, squeeze=False)[0]
        for axes in all_axes:
            axes.set_axis_off()
        first = strip.panels[0].cloud
        style, eye = CloudStyle.of(first, strip.sensor), look_at(first.xyz, strip.sensor.projection)
        for axes, (heading, cloud, caption) in zip(all_axes, strip.panels):
            axes.imshow(draw_surface(cloud.xyz, style.shaded(cloud), eye, _CLOUD_PX, _CLOUD_PX, style.radius_m,
                                     BACKGROUND))
            axes.set_title(heading, loc="left", size=10, parse_math=False)
            axes.text(0, -0.03, caption, transform=axes.transAxes, va="top", size=8.5, parse_math=False)
    save_png(figure, path)
