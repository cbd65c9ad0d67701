"""One cloud as a recording, for `srt3d reconstruct -o cloud.rrd`."""

import uuid
from pathlib import Path

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import layout
from srt3d_ros.recording.blueprint import still_blueprint
from srt3d_ros.recording.file_part import FilePart
from srt3d_ros.recording.frame_log import FrameLog, Style

_APPLICATION_ID = "srt3d_ros_cloud"     # the viewer keeps the layout of single clouds apart from that of films


def save_cloud(cloud: PointCloud, path: Path, sensor: SensorModel, properties: dict) -> None:
    """Write a cloud and its depth image to an .rrd file, every value exactly; OSError if it cannot be written."""
    log = FrameLog(sensor, {layout.RUN: properties}, (layout.DEPTH,), Style(exact=True, blueprint=still_blueprint))
    part = FilePart(path, _APPLICATION_ID, str(uuid.uuid4()))
    log.begin(part.stream)
    columns = {"xyz": cloud.xyz, "intensity": cloud.intensity, "row": cloud.row, "col": cloud.col,
               "surface": cloud.surface, "depth_std": cloud.depth_std_bins * sensor.bin_width_m}
    log.cloud(cloud.stamp_ns, 0, columns)
    log.depth(cloud.stamp_ns, 0, cloud.depth_image(sensor.projection))
    log.end(part.stream)
    part.close()
