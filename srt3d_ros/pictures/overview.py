"""The picture of a run: the photons as they came, the cloud made of them, and its depth map."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.pictures.look import BACKGROUND, RANGE_MAP, Look
from srt3d_ros.pictures.marks import DIM, TEXT, caption, hex_colour, scale_bar
from srt3d_ros.pictures.raster import draw_fog
from srt3d_ros.viewpoint import Viewpoint, look_at, pixel_pitch_rad, sensor_axes

_WIDTH_PX, _HEIGHT_PX, _DPI = 2000, 900, 100
_BOTTOM, _TOP = 0.09, 0.80                      # of the panels, shares of the height
_SPECK_OPACITY, _FADE = 0.6, 0.08               # of a photon; of the panel
_SPARSE = 0.4                                   # photons per picture element below which they are drawn larger
_MOST_PHOTONS = 1_000_000                       # drawn; of more, an even sample


def draw_overview(path, cloud: PointCloud, sensor: SensorModel, photons: PhotonEvents | None, title: str,
                  figures: dict) -> None:
    """Write a .png: photons, cloud and depth map side by side, the same colours for the same range.

    Args:
        path: the picture; its directory must exist.
        cloud: may be empty, which the picture then says.
        photons: those the cloud was made of; without them their panel is left out.
        title: what is seen.
        figures: shown below, in order: {"photons per pixel": 10.0, "points": 19_871, "reconstruction": "35 ms"}.

    Raises:
        InvalidInput: if the picture cannot be written there.
    """
    look = Look.of(cloud, sensor)
    figure = Figure((_WIDTH_PX / _DPI, _HEIGHT_PX / _DPI), dpi=_DPI, facecolor=hex_colour(BACKGROUND))
    FigureCanvasAgg(figure)
    _line(figure, 0.94, title, 25, color=TEXT, weight="bold")
    _line(figure, 0.045, caption(figures), 15, color=DIM)
    left, photon_xyz = 0.02, None if photons is None else _positions(photons, sensor)
    framed = cloud.xyz if len(cloud) or photons is None else photon_xyz
    if photons is not None:
        width = 0.28
        eye = look_at(framed, sensor.projection, aspect=_aspect(width))
        _panel(figure, left, width, lambda w, h: _photons(photon_xyz, look, eye, w, h),
               f"{photons.photons:,} photons", "each at its pixel and time of arrival")
        left = 0.31
    width = 0.69 - left
    eye = look_at(framed, sensor.projection, aspect=_aspect(width))
    axes = _panel(figure, left, width, lambda w, h: look.draw(cloud, eye, w, h),
                  f"{len(cloud):,} points", "coloured by range, shaded by intensity")
    if len(cloud) == 0:
        axes.text(0.5, 0.5, "no points", color=DIM, size=20, ha="center", transform=axes.transAxes)
    else:
        scale_bar(axes, eye)
    _depth_map(figure, 0.71, 0.235, cloud.range_image(), look)
    try:
        figure.savefig(Path(path), format="png", dpi=_DPI, facecolor=figure.get_facecolor())
    except OSError as e:
        raise InvalidInput("picture", str(path), f"a file that can be written ({e.strerror or e})") from None


def _positions(photons: PhotonEvents, sensor: SensorModel) -> np.ndarray:
    """Where each photon was seen, float32 [N, 3] metres: anywhere in its pixel and bin, or the pixels make moiré."""
    chosen = slice(None, None, max(-(-photons.photons // _MOST_PHOTONS), 1))
    rng = np.random.default_rng(0)
    row, col = np.divmod(photons.pixel[chosen], sensor.cols)
    xyz = sensor.xyz(row, col, sensor.toa_positions(photons.toa[chosen]) + rng.uniform(-0.5, 0.5, len(row)))
    aside = rng.uniform(-0.5, 0.5, (len(xyz), 2)).astype(np.float32) * np.float32(pixel_pitch_rad(sensor))
    right_up = sensor_axes(sensor.projection)[1:].astype(np.float32)
    return xyz + np.linalg.norm(xyz, axis=1, keepdims=True) * (aside @ right_up)


def _photons(xyz: np.ndarray, look: Look, eye: Viewpoint, width: int, height: int) -> np.ndarray:
    """The photons as a fog that fades at the borders: what goes on there is not cut off."""
    size_px = 1 if len(xyz) > _SPARSE * width * height else 2
    fog = draw_fog(xyz, look.colour(xyz), eye, width, height, _SPECK_OPACITY, size_px, BACKGROUND)
    inside = [np.clip(np.minimum(np.arange(n), n - 1 - np.arange(n)) / (_FADE * n), 0, 1) for n in (height, width)]
    weight = np.outer(*inside)[..., None]
    return (fog * weight + np.array(BACKGROUND) * (1 - weight)).astype(np.uint8)


def _aspect(width: float) -> float:
    """Width over height of a panel that takes `width` of the figure's."""
    return width * _WIDTH_PX / ((_TOP - _BOTTOM) * _HEIGHT_PX)


def _depth_map(figure: Figure, left: float, width: float, range_m: np.ndarray, look: Look) -> None:
    rows, cols = range_m.shape
    # As large as fits, in the middle of the panel's height; sizes as shares of the figure.
    size_px = min(width * _WIDTH_PX / cols, (_TOP - _BOTTOM) * _HEIGHT_PX / rows)
    width, height = cols * size_px / _WIDTH_PX, rows * size_px / _HEIGHT_PX
    bottom = (_TOP + _BOTTOM - height) / 2
    colours = ListedColormap(RANGE_MAP / 255).with_extremes(bad=hex_colour(BACKGROUND))
    scale = Normalize(look.near_m, look.far_m)
    axes = figure.add_axes((left, bottom, width, height))
    axes.set_axis_off()
    axes.imshow(range_m, cmap=colours, norm=scale, interpolation="nearest", aspect="auto")
    _heading(figure, left, "depth map", f"{rows} × {cols} pixels, range in metres")
    beside = figure.add_axes((left + width + 0.008, bottom, 0.007, height))
    bar = figure.colorbar(ScalarMappable(scale, colours), cax=beside)
    bar.outline.set_visible(False)
    bar.ax.invert_yaxis()
    bar.ax.tick_params(colors=DIM, labelsize=13, length=0)


def _panel(figure: Figure, left: float, width: float, draw: Callable[[int, int], np.ndarray], heading: str, note: str):
    """A panel filled by `draw(width, height)`, element for element."""
    axes = figure.add_axes((left, _BOTTOM, width, _TOP - _BOTTOM))
    axes.set_axis_off()
    image = draw(round(width * _WIDTH_PX), round((_TOP - _BOTTOM) * _HEIGHT_PX))
    axes.imshow(image, interpolation="nearest", aspect="auto")
    _heading(figure, left, heading, note)
    return axes


def _line(figure: Figure, height: float, text: str, size: float, **style) -> None:
    """A line of text over the figure's width, smaller if it is long; a $ in it is a $."""
    size = min(size, _WIDTH_PX / max(len(text), 1))
    figure.text(0.02, height, text, size=size, va="center", parse_math=False, **style)


def _heading(figure: Figure, left: float, heading: str, note: str) -> None:
    figure.text(left, _TOP + 0.055, heading, color=TEXT, size=17, va="bottom")
    figure.text(left, _TOP + 0.02, note, color=DIM, size=13, va="bottom")
