"""What is empty: rays from the sensor to their ends, only in reports of recordings that have some."""

import numpy as np

from srt3d_ros.recording.writer import RecordingWriter
from srt3d_ros.review import gallery
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.report import write_report
from srt3d_ros.review.summary import summarise


def bluish(recorded, cloud, ends) -> int:
    """Pixels in which rays are seen."""
    style = gallery.CloudStyle.of(cloud, recorded.sensor)
    picture = np.asarray(gallery.draw_fan(recorded, cloud, ends, style, 300, 175)).astype(int)
    return int(((picture[..., 2] > picture[..., 0] + 12) & (picture[..., 2] < 230)).sum())


def test_rays_are_drawn_in_a_picture_of_their_own(tmp_path, ball, recorded, monkeypatch):
    monkeypatch.setattr(gallery, "_LARGE_PX", (300, 175))
    cloud, sensor = ball
    ends = (1.5 * np.abs(cloud.xyz).max() * sensor.rays[::4, ::4].reshape(-1, 3)).astype(np.float32)
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        for k in range(3):
            writer.log_cloud(k * 10**8, k, cloud.xyz, cloud.intensity)
            writer.log_free(k * 10**8, k, ends)
    fanned = Recorded.read(tmp_path / "a.rrd")
    for each, expected in ((fanned, True), (recorded, False)):
        write_report(each, summarise(each), tmp_path / "a.html")
        assert ("What is empty" in (tmp_path / "a.html").read_text()) == expected
    one = next(fanned.reader.clouds())
    assert bluish(fanned, one, ends) > bluish(fanned, one, 0 * ends) + 2000
