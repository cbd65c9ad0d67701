"""Write one cloud as a recording."""

from pathlib import Path

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.recording import entities
from srt3d_ros.recording.writer import RecordingFailed, RecordingWriter

_IMAGES = (entities.DEPTH_PATH, entities.INTENSITY_PATH, entities.BACKGROUND_PATH)


def record_cloud(cloud: PointCloud, path: Path, notes: tuple[str, ...] = ()) -> None:
    """Write a recording of one frame to a new file; OSError if that fails."""
    facts = {"method": cloud.method, "device": cloud.device, "frequencies": cloud.frequencies, "notes": notes}
    at, pixels = (cloud.stamp_ns, 0), cloud.background.size
    images = (cloud.depth_image(cloud.sensor.projection), cloud.image("intensity"), cloud.background)
    try:
        with RecordingWriter(path, cloud.sensor, {entities.RUN: facts}, images=_IMAGES, still=True) as writer:
            writer.log_cloud(*at, cloud.xyz, cloud.intensity, row=cloud.row, col=cloud.col, surface=cloud.surface,
                             depth_std=cloud.depth_std_bins * cloud.sensor.bin_width_m)
            for name, image in zip(_IMAGES, images):
                writer.log_image(name, *at, image)
            writer.log_scalars(cloud.stamp_ns, {"points": len(cloud), "photons": cloud.photons,
                                                "ppp": cloud.photons / pixels}, 0)
    except RecordingFailed as error:
        raise OSError(error.why) from None
