"""The pictures of a report: notable clouds, clouds over time, and the images of a typical frame."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from srt3d_ros.pictures.annotations import annotated
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.colours import BACKGROUND, percentile_range
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
_JPEG = {"quality": 88, "subsampling": 0}


@dataclass(frozen=True)
class Picture:
    """A picture of the report, as a data: URI."""

    title: str
    caption: str
    uri: str


def make_gallery(recorded: Recorded) -> dict:
    """Choose, read and draw clouds from one viewpoint.

    Returns:
        `typical`, a Picture of a typical cloud; `ends`, of those with the fewest and the most points; `strip`,
        of clouds spaced evenly in time; `way`, that of a sensor that moved, or None; `fan`, what is empty around the
        typical cloud, or None; `images`, those recorded with or near the typical cloud.
    """
    index = recorded.index
    typical, fewest, most = notable_frames(recorded)
    strip = np.unique(np.linspace(0, len(index) - 1, min(_STRIP, len(index))).round().astype(int))
    frames = {position: int(index.frame_index[position]) for position in (typical, fewest, most, *strip)}
    by_frame = {cloud.frame_index: cloud for cloud in recorded.reader.clouds(set(frames.values()))}
    clouds = {position: by_frame[frame] for position, frame in frames.items()}
    framed, style = clouds[typical], CloudStyle.of(clouds[typical], recorded.sensor)
    titles = {fewest: "fewest points", most: "most points", typical: "typical"}
    near, far = (look_at(framed.xyz, recorded.sensor.projection, aspect=width / height)
                 for width, height in (_LARGE_PX, _SMALL_PX))
    large = {position: _cloud_picture(recorded, position, title,
                                      annotated(style.draw(clouds[position], near, *_LARGE_PX), style, near))
             for position, title in titles.items()}
    return {
        "typical": large.pop(typical), "ends": list(large.values()),
        "strip": [_thumbnail(recorded, position, style.draw(clouds[position], far, *_SMALL_PX))
                  for position in strip],
        "way": _way(recorded), "fan": _fan(recorded, framed, style),
        "images": _images(recorded, frames[typical]),
    }


def _way(recorded: Recorded) -> Picture | None:
    drawn = draw_way(recorded, *_LARGE_PX)
    return drawn and Picture("From above", f"The sensor's way, {length_text(drawn[1])}, to the dot. Points more than "
                             "0.5 m above the sensor are left out.", data_uri(drawn[0], "jpeg", **_JPEG))


def _fan(recorded: Recorded, cloud: RecordedCloud, style: CloudStyle) -> Picture | None:
    for _, _, ends in recorded.reader.empty_rays([cloud.frame_index]):
        image = draw_fan(recorded, cloud, ends, style, *_LARGE_PX)
        return Picture("What is empty", "Each ray ends where it stops being empty for certain. Pixels without ray or "
                       "point are unknown.", data_uri(image, "jpeg", **_JPEG))


def _cloud_picture(recorded: Recorded, position: int, title: str, image: Image.Image) -> Picture:
    index = recorded.index
    figures = [f"{index.points[position]:,} points"]
    photons, latency_ms = (recorded.at_clouds(name)[position] for name in ("photons", "latency_ms"))
    if np.isfinite(photons):
        figures.append(f"{photons:,.0f} photons")
    if np.isfinite(latency_ms):
        figures.append(f"latency {latency_ms:.0f} ms")
    stamp = iso_time(index.stamp_ns[position]).replace("T", " ").replace("Z", " UTC")
    return Picture(f"Frame {index.frame_index[position]}: {title}", ", ".join([*figures, stamp]),
                   data_uri(image, "jpeg", **_JPEG))


def _thumbnail(recorded: Recorded, position: int, image: np.ndarray) -> Picture:
    caption = f"frame {recorded.index.frame_index[position]}, {recorded.index.points[position]:,} points"
    return Picture(f"{recorded.seconds[position]:.1f} s", caption, data_uri(Image.fromarray(image), "jpeg", **_JPEG))


def _images(recorded: Recorded, frame: int) -> list[Picture]:
    pictures = []
    for path, title in entities.IMAGE_TITLES.items():
        near = list(recorded.reader.images(path, range(frame - _NEAR, frame + _NEAR + 1)))
        if near:
            _, _, values = min(near, key=lambda image: abs(image[1] - frame))
            quantity = RANGE if path == entities.DEPTH_PATH else PHOTONS
            low, high = percentile_range(values) or (0.0, 1.0)
            colours = quantity.table[quantity.levels(values, (low, high))]
            colours[~np.isfinite(values)] = BACKGROUND
            pictures.append(Picture(title, f"{quantity.text(low)} … {quantity.text(high)}",
                                    data_uri(Image.fromarray(colours), "png", optimize=True)))
    return pictures
