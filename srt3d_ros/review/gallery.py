"""The pictures of a report: notable clouds, clouds over time, and the images of a typical frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from PIL import Image

from srt3d_ros.pictures.annotations import annotated
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.colours import percentile_range
from srt3d_ros.pictures.figures import data_uri
from srt3d_ros.pictures.quantities import PHOTONS, RANGE
from srt3d_ros.pictures.units import length_text
from srt3d_ros.pictures.viewpoint import look_at
from srt3d_ros.recording import entities
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.from_above import draw_fan, draw_way
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import iso_time, notable_frames

_LARGE_PX, _SMALL_PX = (1200, 700), (320, 240)
_STRIP = 12
_NEAR = 50              # frames between the typical one and one with images, at most


@dataclass(frozen=True)
class Picture:
    """A picture of the report, as a data: URI."""

    title: str
    caption: str
    uri: str


def make_gallery(recorded: Recorded) -> dict:
    """Choose, read and draw clouds from one viewpoint.

    Returns:
        `typical`, a Picture of a typical cloud; `strip`, of clouds spaced evenly in time; `way`, that of a sensor that
        moved, or None; `fan`, what is empty around the typical cloud, or None; `images`, those recorded with or near
        the typical cloud.
    """
    frames, typical = recorded.index.frame_index.tolist(), notable_frames(recorded)[0]
    strip = np.unique(np.linspace(0, len(frames) - 1, min(_STRIP, len(frames))).round().astype(int)).tolist()
    clouds = {cloud.frame_index: cloud for cloud in recorded.clouds({frames[k] for k in (typical, *strip)})}
    framed = clouds[frames[typical]]
    style = CloudStyle.of(framed, recorded.sensor)
    near, far = (look_at(framed.xyz, recorded.sensor.projection, aspect=width / height)
                 for width, height in (_LARGE_PX, _SMALL_PX))
    return {
        "typical": _typical(recorded, typical, annotated(style.draw(framed, near, *_LARGE_PX), style, near)),
        "strip": [_thumbnail(recorded, position, style.draw(clouds[frames[position]], far, *_SMALL_PX))
                  for position in strip],
        "way": _way(recorded), "fan": _fan(recorded, framed, style),
        "images": [*_images(recorded, framed.frame_index)],
    }


def _jpeg(title: str, caption: str, image: Image.Image) -> Picture:
    return Picture(title, caption, data_uri(image, "jpeg", quality=88, subsampling=0))


def _way(recorded: Recorded) -> Picture | None:
    drawn = draw_way(recorded, *_LARGE_PX)
    return drawn and _jpeg("From above", f"The sensor's way, {length_text(drawn[1])}, to the dot. Points more than "
                           "0.5 m above the sensor are left out.", drawn[0])


def _fan(recorded: Recorded, cloud: RecordedCloud, style: CloudStyle) -> Picture | None:
    for _, _, ends in recorded.empty_rays([cloud.frame_index]):
        return _jpeg("What is empty", "Each ray ends where it stops being empty for certain. Pixels without ray or "
                     "point are unknown.", draw_fan(recorded, cloud, ends, style, *_LARGE_PX))


def _typical(recorded: Recorded, position: int, image: Image.Image) -> Picture:
    index = recorded.index
    figures = [f"{index.points[position]:,} points"]
    for name, form in (("photons", "{:,.0f} photons"), ("latency_ms", "latency {:.0f} ms")):
        if np.isfinite(value := recorded.at_cloud(name, position)):
            figures.append(form.format(value))
    figures.append(iso_time(index.stamp_ns[position]).replace("T", " ").replace("Z", " UTC"))
    return _jpeg(f"Frame {index.frame_index[position]}: typical", ", ".join(figures), image)


def _thumbnail(recorded: Recorded, position: int, image: np.ndarray) -> Picture:
    caption = f"frame {recorded.index.frame_index[position]}, {recorded.index.points[position]:,} points"
    return _jpeg(f"{recorded.seconds[position]:.1f} s", caption, Image.fromarray(image))


def _images(recorded: Recorded, frame: int) -> Iterator[Picture]:
    for path, title in entities.IMAGE_TITLES.items():
        near = recorded.images(path, range(frame - _NEAR, frame + _NEAR + 1))
        if image := min(near, key=lambda image: abs(image[1] - frame), default=None):
            values, quantity = image[2], RANGE if path == entities.DEPTH_PATH else PHOTONS
            low, high = ends = percentile_range(values) or (0.0, 1.0)
            yield Picture(title, f"{quantity.text(low)} … {quantity.text(high)}",
                          data_uri(Image.fromarray(quantity.image(values, ends)), "png", optimize=True))
