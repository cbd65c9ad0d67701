"""The pictures of a report: telling clouds, a strip over the whole time, and the images of the typical frame."""

import base64
import io
from dataclasses import dataclass

import numpy as np
from PIL import Image

from srt3d_ros.colours import colour_table, levels, percentile_range
from srt3d_ros.pictures.look import BACKGROUND, RANGE_MAP, Look
from srt3d_ros.pictures.marks import length_text
from srt3d_ros.pictures.still import marked
from srt3d_ros.recording import layout
from srt3d_ros.recording.reader import CloudFrame
from srt3d_ros.review.camera import Camera
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import iso_time, telling_frames

_LARGE_PX, _SMALL_PX = (1200, 700), (320, 240)
_STRIP = 12
_JPEG = {"quality": 88, "subsampling": 0}
_IMAGES = {layout.DEPTH: ("depth", "m"), layout.INTENSITY_IMAGE: ("intensity", "photons"),
           layout.BACKGROUND: ("background", "photons"), layout.PHOTONS: ("photons as they came", "photons")}
_MAP = "inferno"


@dataclass(frozen=True)
class Picture:
    """A picture for a page: what it shows, more about it in a few words, and the picture as a data: URI."""

    title: str
    caption: str
    uri: str


@dataclass(frozen=True)
class Gallery:
    """The pictures of a report.

    Args:
        typical: a typical cloud.
        ends: those with the fewest and the most points.
        strip: clouds evenly spaced over the recording.
        images: depth, intensity, … of the typical cloud's frame, as far as recorded.
        by: who drew the large ones.
    """

    typical: Picture
    ends: list[Picture]
    strip: list[Picture]
    images: list[Picture]
    by: str


def make_gallery(recorded: Recorded, pictures: str) -> Gallery:
    """Choose, read and draw; `pictures` as for Camera."""
    index = recorded.index
    typical, fewest, most = telling_frames(recorded)
    strip = np.unique(np.linspace(0, len(index) - 1, min(_STRIP, len(index))).round().astype(int))
    wanted = {int(index.frame_index[k]) for k in (typical, fewest, most, *strip)}
    clouds = {cloud.frame_index: cloud for cloud in recorded.reader.clouds(wanted)}

    def cloud(place: int) -> CloudFrame:
        return clouds[int(index.frame_index[place])]

    projection = recorded.sensor.projection if recorded.sensor else None
    look = Look.of(cloud(typical), recorded.sensor)
    camera = Camera(pictures, cloud(typical), look, projection, *_LARGE_PX)
    places = list(dict.fromkeys((typical, fewest, most)))
    large = dict(zip(places, camera.draw([cloud(place) for place in places])))
    titles = {fewest: "Fewest points", most: "Most points"}
    small = Camera("own", cloud(typical), look, projection, *_SMALL_PX)
    return Gallery(
        _cloud_picture(recorded, typical, "A typical cloud", large[typical], camera),
        [_cloud_picture(recorded, place, title, large[place], camera) for place, title in titles.items()
         if place != typical],
        [_thumbnail(recorded, place, image)
         for place, image in zip(strip, small.draw([cloud(place) for place in strip]))],
        _images(recorded, int(index.frame_index[typical]), look),
        "the rerun viewer" if camera.by_viewer else "srt3d_ros")


def figures_of(recorded: Recorded, place: int) -> dict:
    """What a caption says of a cloud."""
    figures = {"points": int(recorded.points[place])}
    photons, latency_ms = (recorded.at_clouds(name)[place] for name in ("photons", "latency_ms"))
    if np.isfinite(photons):
        figures["photons"] = int(photons)
    if np.isfinite(latency_ms):
        figures["latency"] = f"{latency_ms:.0f} ms"
    return figures


def title_of(recorded: Recorded, place: int) -> str:
    """Frame and stamp of a cloud."""
    stamp = iso_time(recorded.index.stamp_ns[place]).replace("T", " ").replace("Z", " UTC")
    return f"Frame {recorded.index.frame_index[place]}, {stamp}"


def _cloud_picture(recorded: Recorded, place: int, title: str, image: np.ndarray, camera: Camera) -> Picture:
    figures = ", ".join(f"{value:,} {name}" if isinstance(value, int) else f"{name} {value}"
                        for name, value in figures_of(recorded, place).items())
    return Picture(title, f"{title_of(recorded, place)}: {figures}", _jpeg(marked(image, camera.look, camera.eye)))


def _thumbnail(recorded: Recorded, place: int, image: np.ndarray) -> Picture:
    caption = f"frame {recorded.index.frame_index[place]}, {recorded.points[place]:,} points"
    return Picture(f"{recorded.seconds[place]:.1f} s", caption, _jpeg(Image.fromarray(image)))


def _images(recorded: Recorded, frame: int, look: Look) -> list[Picture]:
    pictures = []
    for path, (title, unit) in _IMAGES.items():
        for _, _, values in recorded.reader.images(path, {frame}):
            low, high = (look.near_m, look.far_m) if unit == "m" else percentile_range(values) or (0.0, 1.0)
            table = RANGE_MAP if unit == "m" else colour_table(_MAP)
            colours = table[levels(values, low, high)]
            colours[~np.isfinite(values)] = BACKGROUND
            ends = " … ".join(length_text(float(f"{end:.3g}")) if unit == "m" else f"{end:.3g}" for end in (low, high))
            pictures.append(Picture(title, ends if unit == "m" else f"{ends} {unit}", _png(Image.fromarray(colours))))
    return pictures


def _jpeg(image: Image.Image) -> str:
    return _uri(image, "jpeg", **_JPEG)


def _png(image: Image.Image) -> str:
    return _uri(image, "png", optimize=True)


def _uri(image: Image.Image, kind: str, **options) -> str:
    data = io.BytesIO()
    image.save(data, kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(data.getvalue()).decode()}"
