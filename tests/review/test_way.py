"""The way of a sensor from above: where it went among what it saw, and no ceiling over it."""

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.recording.writer import RecordingWriter
from srt3d_ros.review import gallery
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.report import write_report
from srt3d_ros.review.summary import summarise
from srt3d_ros.review.way import draw_way

SENSOR = SensorModel(32, 32, 1000, 1e-10, np.ones(3))
OPTICAL = Pose.from_quaternion((0.5, -0.5, 0.5, -0.5), (0, 0, 1))
WIDTH, HEIGHT = 400, 300


def test_the_way_is_drawn_among_the_points_and_a_ceiling_is_not(tmp_path):
    """A square room of 10 m with a ceiling; the sensor goes 3 m to the right, x, then 3 m up the page, y."""
    edge = np.linspace(-5, 5, 101)
    walls = np.array([(x, y, z) for z in (0.0, 1.0) for k in edge for x, y in ((k, -5), (k, 5), (-5, k), (5, k))])
    ceiling = np.array([(x, y, 3.0) for x in edge for y in edge])
    room = np.vstack([walls, ceiling])
    with RecordingWriter(tmp_path / "a.rrd", SENSOR) as writer:
        for k, (x, y) in enumerate(((0, 0), (3, 0), (3, 3))):
            pose = Pose(translation=np.array([x, y, 0.0])) @ OPTICAL
            writer.log_cloud(k * 10**8, k, pose.inverse()(room).astype(np.float32), np.ones(len(room), np.float32))
            writer.log_pose(k * 10**8, k, pose)
    picture, length_m = draw_way(Recorded.read(tmp_path / "a.rrd"), WIDTH, HEIGHT)
    assert np.isclose(length_m, 6)
    pixels = np.asarray(picture).astype(int)
    rows, cols = np.nonzero(pixels[..., 0] - pixels[..., 2] > 100)      # orange
    bright = np.nonzero((pixels.max(axis=2) > 60) & (pixels[..., 0] - pixels[..., 2] < 50))
    px_per_m = np.ptp(bright[0][bright[1] < WIDTH // 2]) / 10
    assert np.allclose([np.ptp(cols) / px_per_m, np.ptp(rows) / px_per_m], 3, atol=0.6)
    assert abs(cols.min() - WIDTH / 2) < 0.5 * px_per_m and abs(rows.max() - HEIGHT / 2) < 0.5 * px_per_m
    below = pixels[int(HEIGHT / 2 + px_per_m):int(HEIGHT / 2 + 3 * px_per_m), WIDTH // 2 - 20:WIDTH // 2 + 20]
    assert below.max() < 60


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
