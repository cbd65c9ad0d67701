"""Export a cloud of a recording as a cloud file, a picture or a turning film; or all clouds as a bag."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.viewpoint import Viewpoint, look_at
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import check_place, writing
from srt3d_ros.pictures.annotations import annotated
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.recording import cloud_files, schema
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.gallery import draw, figures_of, title_of
from srt3d_ros.review.recorded import Recorded

_PICTURE_PX = (1400, 800)
FRAME_SUFFIXES = (".npz", ".ply", ".pcd", ".rrd", *cloud_files.PICTURES)
TURNTABLE_SUFFIXES = (".gif", ".mp4")
_FILM_PX, _FILM_FRAMES, _FILM_RATE_HZ = (640, 480), 60, 20
_FILM_COLOURS = 128
_SWING_DEG = 40             # a cloud seen from one side has no back to show


def check_output(output: Path, suffixes: tuple[str, ...]) -> None:
    """Check suffix and directory of an output before any work; InvalidInput if they do not suit."""
    require(output.suffix.lower() in suffixes, "output", str(output), f"a file name that ends in {', '.join(suffixes)}")
    check_place(output)


def save_frame(recorded: Recorded, position: int, output: Path, pictures: str = "auto") -> None:
    """Save the cloud at a position of the index: a picture if `output` is called so, else as `cloud_files.save` does.

    Raises:
        InvalidInput: it cannot be written there, or a cloud file needs a sensor and the recording has none.
    """
    cloud = _cloud(recorded, position)
    if output.suffix.lower() in cloud_files.PICTURES:
        style = CloudStyle.of(cloud, recorded.sensor)
        (image,), eye, _ = draw([cloud], cloud, style, recorded.projection, _PICTURE_PX, pictures)
        picture = annotated(image, style, eye, title_of(recorded, position), figures_of(recorded, position))
        with writing("output", output):
            picture.save(output, optimize=True)
        return
    require(recorded.sensor is not None, "recording", str(recorded.path), "one that describes its sensor")
    frequencies = np.atleast_1d(recorded.properties.get("run", {}).get("frequencies", ())).tolist()
    background = next((image for *_, image in recorded.reader.images(schema.BACKGROUND, {cloud.frame_index})), None)
    cloud_files.save(point_cloud(cloud, recorded.sensor, background), output, frequencies=tuple(frequencies),
                     sensor=recorded.sensor)


def save_turntable(recorded: Recorded, position: int, output: Path) -> None:
    """Save a .gif, or with imageio-ffmpeg an .mp4, of a cloud that turns to either side and back, to be looped.

    Raises:
        InvalidInput: it cannot be written there, or imageio-ffmpeg is missing.
    """
    write = {".gif": _write_gif, ".mp4": _write_mp4}[output.suffix.lower()]
    with writing("turntable", output):
        write(output, tqdm(_turning(recorded, _cloud(recorded, position)), "drawing", _FILM_FRAMES, delay=2,
                           leave=False, unit="picture"))


def save_bag(recorded: Recorded, folder: Path, topic: str = "/points") -> int:
    """Write all clouds as PointCloud2 messages (x, y, z, intensity) with their stamps; returns their number.

    Raises:
        InvalidInput: the folder exists, or cannot be written.
    """
    from srt3d_ros.datasets.bag_writer import BagWriter, Offer
    from srt3d_ros.messages import points

    frame_id = recorded.sensor.frame_id if recorded.sensor else "lidar"
    writer = BagWriter(folder)
    writer.add_topic(topic, "sensor_msgs/msg/PointCloud2", [Offer()])
    for cloud in tqdm(recorded.reader.clouds(), "writing", len(recorded.index), delay=2, leave=False, unit="cloud"):
        empty, zeros = np.empty(0), np.zeros(len(cloud), np.uint16)         # what the message leaves out
        message = PointCloud(zeros, zeros, empty, cloud.intensity, empty, cloud.xyz, empty, empty, cloud.stamp_ns)
        writer.write(topic, cloud.stamp_ns, points.encode_cdr(message, frame_id))
    writer.close()
    return writer.messages[topic]


def point_cloud(cloud: RecordedCloud, sensor: SensorModel, background: np.ndarray | None = None) -> PointCloud:
    """The reconstructed cloud of a recorded one. Pixels that were not recorded are derived from the geometry.

    Args:
        background: float [rows, cols], photons, if recorded; NaN otherwise, as depth_std_bins.
    """
    range_m = np.linalg.norm(cloud.xyz.astype(np.float64), axis=1)
    row, col = (cloud.row, cloud.col) if cloud.row is not None and cloud.col is not None else _pixels(cloud.xyz, sensor)
    rank = -cloud.intensity if cloud.surface is None else cloud.surface
    order = np.lexsort((rank, row.astype(np.int64) * sensor.cols + col))
    depth = sensor.depth_bins(range_m)
    std = np.full(len(cloud), np.nan) if cloud.depth_std_m is None else cloud.depth_std_m / sensor.bin_width_m
    if background is None:
        background = np.full((sensor.rows, sensor.cols), np.nan)
    row, col = row[order].astype(np.uint16), col[order].astype(np.uint16)
    return PointCloud(row, col, depth[order].astype(np.float32), cloud.intensity[order], std[order].astype(np.float32),
                      cloud.xyz[order], _ranks(row, col), background.astype(np.float32), cloud.stamp_ns)


def _pixels(xyz: np.ndarray, sensor: SensorModel) -> tuple[np.ndarray, np.ndarray]:
    """The pixels whose rays pass nearest to points."""
    from scipy.spatial import cKDTree

    direction = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    return np.divmod(cKDTree(sensor.rays.reshape(-1, 3)).query(direction)[1], sensor.cols)


def _ranks(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """0 for the first point of a pixel, 1 for the next, …; the points must be sorted by pixel."""
    begins = np.flatnonzero((np.diff(row.astype(int), prepend=-1) != 0) | (np.diff(col.astype(int), prepend=-1) != 0))
    return (np.arange(len(row)) - np.repeat(begins, np.diff(begins, append=len(row)))).astype(np.uint8)


def _cloud(recorded: Recorded, position: int) -> RecordedCloud:
    return next(iter(recorded.reader.clouds({int(recorded.index.frame_index[position])})))


def _turning(recorded: Recorded, cloud: RecordedCloud) -> Iterator[np.ndarray]:
    """The pictures of the film, all from the same distance of the same target."""
    width, height = _FILM_PX
    style = CloudStyle.of(cloud, recorded.sensor)
    middle = look_at(cloud.xyz, recorded.projection, yaw_deg=0, aspect=width / height, margin=1.25)
    distance = np.linalg.norm(middle.position - middle.target)
    drawn: dict[float, np.ndarray] = {}         # by angle: each comes twice
    for k in range(_FILM_FRAMES):
        yaw_deg = round(_SWING_DEG * np.sin(2 * np.pi * k / _FILM_FRAMES), 3)
        if yaw_deg not in drawn:
            towards = look_at(cloud.xyz, recorded.projection, yaw_deg=yaw_deg).axes()[2]
            eye = Viewpoint(middle.target - distance * towards, middle.target, middle.up, middle.fov_deg)
            drawn[yaw_deg] = style.draw(cloud, eye, width, height)
        yield drawn[yaw_deg]


def _write_gif(path: Path, images: Iterator[np.ndarray]) -> None:
    # One palette for all pictures, which are stacked to choose it: the background does not flicker.
    strip = Image.fromarray(np.concatenate(list(images))).quantize(_FILM_COLOURS, dither=Image.Dither.NONE)
    width, height = _FILM_PX
    first, *rest = (strip.crop((0, top, width, top + height)) for top in range(0, strip.height, height))
    first.save(path, save_all=True, append_images=rest, duration=1000 / _FILM_RATE_HZ, loop=0)


def _write_mp4(path: Path, images: Iterator[np.ndarray]) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ModuleNotFoundError:
        raise InvalidInput("turntable", str(path), "a .gif; for .mp4: pip install imageio-ffmpeg") from None
    film = write_frames(str(path), _FILM_PX, fps=_FILM_RATE_HZ, quality=8)
    film.send(None)
    for image in images:
        film.send(np.ascontiguousarray(image))
    film.close()
