"""A film of one cloud that turns to either side and back, to be played in a loop."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from srt3d_ros.core.projection import Projection
from srt3d_ros.errors import InvalidInput
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.viewpoint import Viewpoint, look_at

SUFFIXES = (".gif", ".mp4")
SIZE_PX, FRAMES = (640, 480), 60
_RATE_HZ = 20
_SWING_DEG = 40             # a cloud seen from one side has no back to show
_COLOURS = 128


def save_turntable(path: Path, cloud, style: CloudStyle, projection: Projection | None,
                   size_px: tuple[int, int] = SIZE_PX, frames: int = FRAMES) -> None:
    """Write a .gif, or with imageio-ffmpeg an .mp4.

    Args:
        path: its suffix says which.
        cloud: with `xyz` and `intensity`.
        projection: the sensor's, which says where up is; or None.
        size_px: width and height.
        frames: of the whole loop.

    Raises:
        InvalidInput: it cannot be written there, or imageio-ffmpeg is missing.
    """
    write = {".gif": _write_gif, ".mp4": _write_mp4}[path.suffix.lower()]
    try:
        images = tqdm(_images(cloud, style, projection, size_px, frames), "drawing", frames, delay=2, leave=False,
                      unit="picture")
        write(path, images, size_px)
    except OSError as e:
        raise InvalidInput("turntable", str(path), f"a file that can be written ({e.strerror or e})") from None


def _images(cloud, style: CloudStyle, projection: Projection | None, size_px: tuple[int, int], frames: int
            ) -> Iterator[np.ndarray]:
    """The pictures, all from the same distance of the same target."""
    width, height = size_px
    middle = look_at(cloud.xyz, projection, yaw_deg=0, aspect=width / height, margin=1.25)
    distance = np.linalg.norm(middle.position - middle.target)
    drawn: dict[float, np.ndarray] = {}         # by angle: each comes twice
    for k in range(frames):
        yaw_deg = round(_SWING_DEG * np.sin(2 * np.pi * k / frames), 3)
        if yaw_deg not in drawn:
            towards = look_at(cloud.xyz, projection, yaw_deg=yaw_deg).axes()[2]
            eye = Viewpoint(middle.target - distance * towards, middle.target, middle.up, middle.fov_deg)
            drawn[yaw_deg] = style.draw(cloud, eye, width, height)
        yield drawn[yaw_deg]


def _write_gif(path: Path, images: Iterator[np.ndarray], size_px: tuple[int, int]) -> None:
    # One palette for all pictures, which are stacked to choose it: the background does not flicker.
    strip = Image.fromarray(np.concatenate(list(images))).quantize(_COLOURS, dither=Image.Dither.NONE)
    width, height = size_px
    first, *rest = (strip.crop((0, top, width, top + height)) for top in range(0, strip.height, height))
    first.save(path, save_all=True, append_images=rest, duration=1000 / _RATE_HZ, loop=0)


def _write_mp4(path: Path, images: Iterator[np.ndarray], size_px: tuple[int, int]) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ModuleNotFoundError:
        raise InvalidInput("turntable", str(path), "a .gif; for .mp4: pip install imageio-ffmpeg") from None
    film = write_frames(str(path), size_px, fps=_RATE_HZ, quality=8)
    film.send(None)
    for image in images:
        film.send(np.ascontiguousarray(image))
    film.close()
