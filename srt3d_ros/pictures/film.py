"""A film of one cloud that turns to either side and back, so that it can be shown again and again."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from srt3d_ros.core.projection import Projection
from srt3d_ros.errors import InvalidInput
from srt3d_ros.pictures.look import Look
from srt3d_ros.viewpoint import Viewpoint, look_at

SUFFIXES = (".gif", ".mp4")
_SIZE_PX = (640, 480)
_FRAMES, _RATE_HZ = 72, 24
_SWING_DEG = 40             # a cloud seen from one side has no back to show
_COLOURS = 128


def turn(path: Path, cloud, look: Look, projection: Projection | None) -> None:
    """Write a .gif, or with imageio-ffmpeg an .mp4.

    Args:
        path: its suffix says which.
        cloud: with `xyz` and `intensity`.
        look: its colours and size of points.
        projection: the sensor's, which says where up is; or None.

    Raises:
        InvalidInput: it cannot be written there, or not as .mp4 here.
    """
    write = {".gif": _write_gif, ".mp4": _write_mp4}[path.suffix.lower()]
    try:
        write(path, tqdm(_images(cloud, look, projection), "drawing", _FRAMES, delay=2, leave=False, unit="picture"))
    except OSError as e:
        raise InvalidInput("turntable", str(path), f"a file that can be written ({e.strerror or e})") from None


def _images(cloud, look: Look, projection: Projection | None) -> Iterator[np.ndarray]:
    """The pictures, from the same distance of the same place."""
    width, height = _SIZE_PX
    middle = look_at(cloud.xyz, projection, yaw_deg=0, aspect=width / height, margin=1.25)
    distance = np.linalg.norm(middle.position - middle.target)
    seen: dict[float, np.ndarray] = {}          # by angle: on the way back it is the same again
    for k in range(_FRAMES):
        yaw_deg = round(_SWING_DEG * np.sin(2 * np.pi * k / _FRAMES), 3)
        if yaw_deg not in seen:
            towards = look_at(cloud.xyz, projection, yaw_deg=yaw_deg).axes()[2]
            eye = Viewpoint(middle.target - distance * towards, middle.target, middle.up, middle.fov_deg)
            seen[yaw_deg] = look.draw(cloud, eye, width, height)
        yield seen[yaw_deg]


def _write_gif(path: Path, images: Iterator[np.ndarray]) -> None:
    first, *rest = (Image.fromarray(image) for image in images)
    palette = first.quantize(_COLOURS, dither=Image.Dither.NONE)       # one for all: nothing flickers
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in rest]
    palette.save(path, save_all=True, append_images=frames, duration=1000 / _RATE_HZ, loop=0, optimize=True)


def _write_mp4(path: Path, images: Iterator[np.ndarray]) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ModuleNotFoundError:
        raise InvalidInput("turntable", str(path), "a .gif; for .mp4: pip install imageio-ffmpeg") from None
    film = write_frames(str(path), _SIZE_PX, fps=_RATE_HZ, quality=8)
    film.send(None)
    for image in images:
        film.send(np.ascontiguousarray(image))
    film.close()
