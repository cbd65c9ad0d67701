"""One cloud as a recording, for `srt3d reconstruct -o cloud.rrd`."""

from pathlib import Path

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording.blueprint import still_blueprint
from srt3d_ros.recording.frame_log import FrameLog

_APPLICATION_ID = "srt3d_ros_cloud"     # the viewer keeps the layout of single clouds apart from that of films


def save_cloud(cloud: PointCloud, path: Path, sensor: SensorModel, properties: dict) -> None:
    """Write a cloud and its depth image to an .rrd file; OSError if it cannot be written."""
    log = FrameLog(path, sensor, _APPLICATION_ID, properties, still_blueprint)
    log.cloud(cloud.stamp_ns, 0, cloud.xyz, cloud.intensity)
    log.depth(cloud.stamp_ns, 0, cloud.depth_image(sensor.projection))
    log.close()
