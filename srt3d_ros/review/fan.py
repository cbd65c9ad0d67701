"""The points of a frame and the rays along which it is empty, seen from above beside the sensor."""

import numpy as np
from PIL import Image

from srt3d_ros.pictures import annotations
from srt3d_ros.pictures.cloud_renderer import CloudStyle, project
from srt3d_ros.pictures.figures import as_image
from srt3d_ros.pictures.viewpoint import look_at
from srt3d_ros.recording.reader import RecordedCloud
from srt3d_ros.review.recorded import Recorded

_YAW_DEG, _PITCH_DEG = 50, 35
_RAY = {"color": "#8fc4da", "alpha": 0.1, "linewidth": 0.8}       # faint, to show the points behind


def draw_fan(recorded: Recorded, cloud: RecordedCloud, ends: np.ndarray, style: CloudStyle, width_px: int,
             height_px: int) -> Image.Image:
    """The picture; `ends` of the rays, float32 [N, 3], metres, sensor's frame."""
    tips = np.zeros_like(ends)
    eye = look_at(np.vstack([cloud.xyz, ends, tips]), recorded.sensor.projection, _YAW_DEG, _PITCH_DEG,
                  aspect=width_px / height_px)
    figure = annotations.dark_figure(width_px, height_px)
    axes = annotations.image_axes(figure, (0, 0, 1, 1), style.draw(cloud, eye, width_px, height_px))
    axes.autoscale(False)
    x, y, _ = project(np.vstack([tips, ends]), eye, width_px, height_px)
    axes.plot(x.reshape(2, -1), y.reshape(2, -1), **_RAY)
    annotations.scale_bar(axes, eye)
    return as_image(figure)
