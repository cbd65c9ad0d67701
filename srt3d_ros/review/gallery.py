"""The pictures of a report: notable clouds, a strip over time, and the images of the typical frame.

The rerun viewer draws the clouds where it can run, else our own renderer.
"""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from srt3d_ros.colours import colour_table, levels, percentile_range
from srt3d_ros.core.projection import Projection
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.pictures.annotations import annotated, length_text
from srt3d_ros.pictures.cloud_renderer import BACKGROUND, RANGE_MAP, CloudStyle
from srt3d_ros.recording import schema, screenshot
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import iso_time, notable_frames
from srt3d_ros.viewpoint import Viewpoint, look_at

_LARGE_PX, _SMALL_PX = (1200, 700), (320, 240)
_STRIP = 12
_JPEG = {"quality": 88, "subsampling": 0}
_IMAGES = {schema.DEPTH: ("depth", "m"), schema.INTENSITY_IMAGE: ("intensity", "photons"),
           schema.BACKGROUND: ("background", "photons"), schema.PHOTONS: ("photons as they came", "photons")}
_MAP = "inferno"
_OWN_FOV_DEG = 30


class Renderer:
    """Draws clouds from one viewpoint.

    Args:
        kind: "viewer", "own", or "auto": the viewer if possible, else own.
        framed: the cloud that fills the pictures.
        style: colours and radius of the points.
        projection: the sensor's, which says where up is; or None.
        width, height: of the pictures.

    Raises:
        InvalidInput: `kind` is "viewer", which cannot run here.
    """

    def __init__(self, kind: str, framed: RecordedCloud, style: CloudStyle, projection: Projection | None, width: int,
                 height: int):
        possible = screenshot.is_possible()
        require(possible or kind != "viewer", "pictures", kind, f"Vulkan, which the viewer needs: {screenshot.INSTALL}")
        self._may_fall_back, self.style, self.width, self.height = kind == "auto", style, width, height
        self._framed, self._projection = framed, projection
        self.by_viewer = possible and kind != "own"

    @property
    def eye(self) -> Viewpoint:
        """The viewpoint of the pictures; it depends on who draws, so read it after `draw`."""
        fov_deg = screenshot.FOV_DEG if self.by_viewer else _OWN_FOV_DEG
        return look_at(self._framed.xyz, self._projection, fov_deg=fov_deg, aspect=self.width / self.height)

    def draw(self, clouds: Sequence[RecordedCloud]) -> list[np.ndarray]:
        """Draw the clouds; uint8 [height, width, 3] each.

        Raises:
            InvalidInput: `kind` is "viewer", and the viewer failed.
        """
        if self.by_viewer:
            try:
                return screenshot.screenshots([(cloud.xyz, self.style.shaded(cloud)) for cloud in clouds],
                                              self.style.radius_m, self.eye, self.width, self.height, BACKGROUND)
            except screenshot.ScreenshotError as error:
                if not self._may_fall_back:
                    raise InvalidInput("pictures", "viewer", f"a viewer that draws ({error})") from None
                self.by_viewer = False
        eye = self.eye
        return [self.style.draw(cloud, eye, self.width, self.height) for cloud in clouds]


@dataclass(frozen=True)
class Picture:
    """A picture for the report, as a data: URI."""

    title: str
    caption: str
    uri: str


@dataclass(frozen=True)
class Gallery:
    """The pictures of a report.

    Args:
        typical: a typical cloud.
        ends: the clouds with the fewest and the most points.
        strip: clouds evenly spaced over the recording.
        images: the recorded images of the typical cloud's frame.
        by: who drew the large pictures.
    """

    typical: Picture
    ends: list[Picture]
    strip: list[Picture]
    images: list[Picture]
    by: str


def make_gallery(recorded: Recorded, pictures: str) -> Gallery:
    """Choose, read and draw the clouds; `pictures` is the kind of Renderer."""
    index = recorded.index
    typical, fewest, most = notable_frames(recorded)
    strip = np.unique(np.linspace(0, len(index) - 1, min(_STRIP, len(index))).round().astype(int))
    frames = {position: int(index.frame_index[position]) for position in (typical, fewest, most, *strip)}
    by_frame = {cloud.frame_index: cloud for cloud in recorded.reader.clouds(set(frames.values()))}
    clouds = {position: by_frame[frame] for position, frame in frames.items()}
    style = CloudStyle.of(clouds[typical], recorded.sensor)
    renderer, small = (Renderer(kind, clouds[typical], style, recorded.projection, *size)
                       for kind, size in ((pictures, _LARGE_PX), ("own", _SMALL_PX)))
    notable = list(dict.fromkeys((typical, fewest, most)))
    large = dict(zip(notable, renderer.draw([clouds[position] for position in notable])))
    titles = {fewest: "Fewest points", most: "Most points"}
    return Gallery(
        _cloud_picture(recorded, typical, "A typical cloud", large[typical], renderer),
        [_cloud_picture(recorded, position, title, large[position], renderer) for position, title in titles.items()
         if position != typical],
        [_thumbnail(recorded, position, image)
         for position, image in zip(strip, small.draw([clouds[position] for position in strip]))],
        _images(recorded, frames[typical], style), "the rerun viewer" if renderer.by_viewer else "srt3d_ros")


def figures_of(recorded: Recorded, position: int) -> dict:
    """The figures in the caption of a cloud."""
    figures = {"points": int(recorded.points[position])}
    photons, latency_ms = (recorded.at_clouds(name)[position] for name in ("photons", "latency_ms"))
    if np.isfinite(photons):
        figures["photons"] = int(photons)
    if np.isfinite(latency_ms):
        figures["latency"] = f"{latency_ms:.0f} ms"
    return figures


def title_of(recorded: Recorded, position: int) -> str:
    """Frame index and stamp of a cloud."""
    stamp = iso_time(recorded.index.stamp_ns[position]).replace("T", " ").replace("Z", " UTC")
    return f"Frame {recorded.index.frame_index[position]}, {stamp}"


def _cloud_picture(recorded: Recorded, position: int, title: str, image: np.ndarray, renderer: Renderer) -> Picture:
    figures = ", ".join(f"{value:,} {name}" if isinstance(value, int) else f"{name} {value}"
                        for name, value in figures_of(recorded, position).items())
    picture = annotated(image, renderer.style, renderer.eye)
    return Picture(title, f"{title_of(recorded, position)}: {figures}", _uri(picture, "jpeg", **_JPEG))


def _thumbnail(recorded: Recorded, position: int, image: np.ndarray) -> Picture:
    caption = f"frame {recorded.index.frame_index[position]}, {recorded.points[position]:,} points"
    return Picture(f"{recorded.seconds[position]:.1f} s", caption, _uri(Image.fromarray(image), "jpeg", **_JPEG))


def _images(recorded: Recorded, frame: int, style: CloudStyle) -> list[Picture]:
    pictures = []
    for path, (title, unit) in _IMAGES.items():
        for _, _, values in recorded.reader.images(path, {frame}):
            low, high = (style.near_m, style.far_m) if unit == "m" else percentile_range(values) or (0.0, 1.0)
            table = RANGE_MAP if unit == "m" else colour_table(_MAP)
            colours = table[levels(values, low, high)]
            colours[~np.isfinite(values)] = BACKGROUND
            ends = " … ".join(length_text(float(f"{end:.3g}")) if unit == "m" else f"{end:.3g}" for end in (low, high))
            picture = _uri(Image.fromarray(colours), "png", optimize=True)
            pictures.append(Picture(title, ends if unit == "m" else f"{ends} {unit}", picture))
    return pictures


def _uri(image: Image.Image, kind: str, **options) -> str:
    data = io.BytesIO()
    image.save(data, kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(data.getvalue()).decode()}"
