"""Pictures of what the sensor passed and of what is empty: points, with lines over them."""

from typing import Any

import numpy as np
from PIL import Image

from srt3d_ros.pictures.annotations import filled_figure, scale_bar
from srt3d_ros.pictures.cloud_renderer import CloudStyle, draw_surface, project
from srt3d_ros.pictures.colours import GREY_TABLE, ORANGE, levels
from srt3d_ros.pictures.figures import as_image
from srt3d_ros.pictures.viewpoint import FROM_ABOVE, Viewpoint, look_at, point_radius_m
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.recorded import Recorded

_CLOUDS, _POINTS = 60, 5000     # along a way, and of each
_ABOVE_M = 0.5                  # over the sensor, from where on points are ceilings, which would hide the room
_MAP_FOV_DEG = 10               # nearly a map
_FAN_YAW_DEG, _FAN_PITCH_DEG = 50, 35
_RAY: dict[str, Any] = {"color": "#8fc4da", "alpha": 0.1, "linewidth": 0.8}       # faint, to show the points behind


def draw_way(recorded: Recorded, width_px: int, height_px: int) -> tuple[Image.Image, float] | None:
    """The way of a sensor that moved, with the points that it saw, and its length in metres; None without poses."""
    poses = dict(sorted(recorded.poses().items()))
    if not poses:
        return None
    seen, light, radius_m = [], [], 0.0
    for cloud in recorded.clouds(set(list(poses)[::-(-len(poses) // _CLOUDS)])):
        pose, some = poses[cloud.frame_index], slice(None, None, max(len(cloud.xyz) // _POINTS, 1))
        fixed = pose(cloud.xyz[some])
        low = fixed[:, 2] < pose.translation[2] + _ABOVE_M
        seen.append(fixed[low])
        light.append((cloud.intensity * (cloud.xyz**2).sum(axis=1))[some][low])
        radius_m = max(radius_m, 2 * point_radius_m(cloud.xyz, recorded.sensor))
    way, xyz, light = np.array([pose.translation for pose in poses.values()]), np.vstack(seen), np.concatenate(light)
    eye = look_at(np.vstack([xyz, way]), None, 0, 0, _MAP_FOV_DEG, width_px / height_px, FROM_ABOVE)
    grey = GREY_TABLE[levels(light, root=True)]
    image = draw_surface(xyz, grey, eye, width_px, height_px, radius_m, finer=2)
    length_m = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    return _with_lines(image, eye, way[:, None], color=ORANGE, linewidth=2, marker="o", markevery=[-1]), length_m


def draw_fan(recorded: Recorded, cloud: RecordedCloud, ends: np.ndarray, style: CloudStyle, width_px: int,
             height_px: int) -> Image.Image:
    """The points of a frame and the rays along which it is empty, up to their `ends`, float32 [N, 3], metres."""
    tips = np.zeros_like(ends)
    eye = look_at(np.vstack([cloud.xyz, ends, tips]), recorded.sensor.projection, _FAN_YAW_DEG, _FAN_PITCH_DEG,
                  aspect=width_px / height_px)
    return _with_lines(style.draw(cloud, eye, width_px, height_px), eye, np.stack([tips, ends]), **_RAY)


def _with_lines(image: np.ndarray, eye: Viewpoint, lines: np.ndarray, **style: Any) -> Image.Image:
    """A picture seen from `eye` with lines over it, [points, lines, 3] in metres, and a scale bar."""
    figure, axes = filled_figure(image)
    x, y, _ = project(lines.reshape(-1, 3), eye, *image.shape[1::-1])
    axes.plot(x.reshape(lines.shape[:2]), y.reshape(lines.shape[:2]), **style)
    scale_bar(axes, eye)
    return as_image(figure)
