"""Draw photons, the cloud reconstructed from them, and its depth map side by side."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.files.new_files import file_errors
from srt3d_ros.pictures import annotations
from srt3d_ros.pictures.annotations import DIM_COLOUR, TEXT_COLOUR
from srt3d_ros.pictures.cloud_renderer import CloudStyle, draw_fog
from srt3d_ros.pictures.colours import BACKGROUND
from srt3d_ros.pictures.figures import DPI, as_image
from srt3d_ros.pictures.units import number_text
from srt3d_ros.pictures.viewpoint import Viewpoint, look_at, pixel_pitch_rad, sensor_axes

_WIDTH_PX, _HEIGHT_PX = 2000, 900              # for the sizes of texts and lines
_FINER = 2                                      # pixels of the file for each of these
_BOTTOM, _TOP = 0.09, 0.80                      # of the panels, shares of the height
_FADE = 0.08                                    # width of the faded border over the panel's
_SPARSE = 0.4                                   # photons per pixel below which they are drawn larger
_MOST_PHOTONS = 1_000_000                       # more are sampled evenly


def draw_overview(path: Path, cloud: PointCloud, photons: PhotonEvents | None, title: str,
                  figures: dict[str, float | str]) -> None:
    """Write a .png with photons, cloud and depth map in the same range colours.

    Args:
        photons: of the cloud's frame; None omits their panel.
        figures: shown below, in order: {"photons per pixel": 10.0, "points": 19_871, "reconstruction": "35 ms"}.
    """
    sensor, style = cloud.sensor, CloudStyle.of(cloud, cloud.sensor)
    figure = annotations.dark_figure(_WIDTH_PX, _HEIGHT_PX)
    figure.set_dpi(_FINER * DPI)
    annotations.write_line(figure, 0.94, title, 25, TEXT_COLOUR, weight="bold")
    caption = "     ".join(f"{name}: {value if isinstance(value, str) else number_text(value)}"
                           for name, value in figures.items())
    annotations.write_line(figure, 0.045, caption, 15, DIM_COLOUR)
    left, framed = 0.02, cloud.xyz
    if photons is not None:
        xyz = photon_positions(photons, sensor)
        framed = cloud.xyz if len(cloud) else xyz
        eye, size = _view(framed, sensor, 0.28)
        _panel(figure, left, 0.28, draw_photons(xyz, style, eye, *size), f"{photons.photons:,} photons",
               "each at its pixel and time of arrival")
        left = 0.31
    eye, size = _view(framed, sensor, 0.69 - left)
    axes = _panel(figure, left, 0.69 - left, style.draw(cloud, eye, *size), f"{len(cloud):,} points",
                  "coloured by range, shaded by intensity; black: hidden from the sensor")
    if len(cloud) == 0:
        axes.text(0.5, 0.5, "no points", color=DIM_COLOUR, size=20, ha="center", transform=axes.transAxes)
    else:
        annotations.scale_bar(axes, eye)
        annotations.range_bar(axes, style, finer=_FINER)
    _panel(figure, 0.71, 0.27, style.quantity.image(cloud.range_image(), style.ends), "depth map",
           f"{sensor.rows} × {sensor.cols} pixels, in the same colours", aspect="equal")
    with file_errors("picture", path):
        as_image(figure).save(path, "png")


def photon_positions(photons: PhotonEvents, sensor: SensorModel) -> np.ndarray:
    """Positions of photons, float32 [N, 3] metres, random within pixel and bin to avoid moiré."""
    chosen = slice(None, None, max(math.ceil(photons.photons / _MOST_PHOTONS), 1))
    rng = np.random.default_rng(0)
    row, col = np.divmod(photons.pixel[chosen], sensor.cols)
    xyz = sensor.xyz(row, col, photons.toa[chosen] + rng.uniform(-0.5, 0.5, len(row)))
    aside = rng.uniform(-0.5, 0.5, (len(xyz), 2)).astype(np.float32) * np.float32(pixel_pitch_rad(sensor))
    right_up = sensor_axes(sensor.projection)[1:].astype(np.float32)
    return xyz + np.linalg.norm(xyz, axis=1, keepdims=True) * (aside @ right_up)


def draw_photons(xyz: np.ndarray, style: CloudStyle, eye: Viewpoint, width: int, height: int) -> np.ndarray:
    """Photons as fog, faded at the borders of the panel."""
    size_px = _FINER if len(xyz) > _SPARSE * width * height / _FINER**2 else 2 * _FINER
    fog = draw_fog(xyz, style.colour(np.linalg.norm(xyz, axis=1)), eye, width, height, size_px)
    inside = [np.clip(np.minimum(np.arange(n), n - 1 - np.arange(n)) / (_FADE * n), 0, 1) for n in (height, width)]
    weight = np.outer(*inside)[..., None]
    return (fog * weight + np.array(BACKGROUND) * (1 - weight)).astype(np.uint8)


def _view(xyz: np.ndarray, sensor: SensorModel, width: float) -> tuple[Viewpoint, tuple[int, int]]:
    """The eye and the size in pixels of a panel with this share of the figure's width."""
    across, down = _FINER * width * _WIDTH_PX, _FINER * (_TOP - _BOTTOM) * _HEIGHT_PX
    return look_at(xyz, sensor.projection, aspect=across / down), (round(across), round(down))


def _panel(figure: Figure, left: float, width: float, image: np.ndarray, heading: str, note: str, **style: Any) -> Axes:
    figure.text(left, _TOP + 0.055, heading, color=TEXT_COLOUR, size=17, va="bottom")
    figure.text(left, _TOP + 0.02, note, color=DIM_COLOUR, size=13, va="bottom")
    return annotations.image_axes(figure, (left, _BOTTOM, width, _TOP - _BOTTOM), image, **style)
