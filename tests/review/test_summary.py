"""The figures of a recording are what it holds; the way and the empty rays are drawn where they were."""

import json

import numpy as np
import pytest
import rerun as rr

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.writer import RecordingWriter
from srt3d_ros.review import gallery
from srt3d_ros.review.from_above import draw_fan, draw_way
from srt3d_ros.review.plots import extremes
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.report import write_report
from srt3d_ros.review.summary import format_summary, summarise
from tests.review.conftest import FEWEST, FRAMES, MISSING, MOST, write_ball


@pytest.fixture(scope="module")
def summary(recorded):
    return json.loads(json.dumps(summarise(recorded), allow_nan=False))


def test_durations_gaps_latencies_points_photons_and_the_text_are_those_of_the_recording(summary, ball):
    assert summary["frames"] == FRAMES - len(MISSING) and summary["duration_s"] == (FRAMES - 1) / 10
    assert summary["period_ms"] == 100 and summary["frame_rate_hz"] == round(27 / 2.9, 3)
    assert summary["gaps"] == 1 and summary["missing_frames"] == 2
    assert summary["longest_gap"] == {"after_frame": 9, "at_s": 0.9, "seconds": 0.3}
    assert summary["started"] == "2026-11-21T18:18:42.000Z" and summary["run"]["frequencies"] == [1, 2, 5]
    values = 30 + np.arange(28)
    assert summary["latency_ms"]["total"] == {"p50": 43.5, "p95": round(float(np.percentile(values, 95)), 3), "max": 57}
    assert summary["latency_ms"]["sketch"] == {"p50": 5, "p95": 5, "max": 5}
    assert (summary["points"]["min"], summary["points"]["max"]) == (len(ball[0]) - 100, len(ball[0]))
    assert (summary["photons"]["min"], summary["photons"]["max"]) == (9000, 9029)
    assert (summary["fewest_points_frame"], summary["most_points_frame"]) == (FEWEST, MOST)
    assert summary["typical_frame"] not in (FEWEST, MOST)
    text = format_summary(summary)
    for expected in ("28, 9.31 Hz", "1, about 2 frames; the longest 0.3 s, at 0.9 s, after frame 9", "median 43.5 ms",
                     "40 × 48 pixels, 600 bins of 20 ps"):
        assert expected in text
    assert "5 min 0 s" in format_summary(summary | {"duration_s": 299.96})


def test_of_many_gaps_the_longest_is_named(tmp_path, ball):
    missing = {*range(2, 120, 4), 71, 91, 92}       # 30 gaps; that after 89 has three frames
    write_ball(tmp_path / "a.rrd", *ball, frames=120, missing=missing)
    recorded = Recorded(tmp_path / "a.rrd")
    summary = summarise(recorded)
    assert summary["gaps"] == 30 and summary["missing_frames"] == len(missing) and recorded.gaps[1] < 60
    assert "the longest 0.4 s, at 8.9 s, after frame " in format_summary(summary)


def test_long_lines_keep_their_extremes_and_leave_out_what_is_not_finite():
    values = np.zeros(10_000)
    values[[77, 5000]] = np.nan, 9
    shown = extremes(values)
    assert 5000 in shown and 77 not in shown and len(shown) <= 1200 and (np.diff(shown) >= 0).all()
    assert extremes(values[70:80]).tolist() == [0, 1, 2, 3, 4, 5, 6, 8, 9]


def test_a_recording_without_a_sensor_or_clouds_is_one_line(tmp_path, ball):
    stream = rr.RecordingStream("other")
    stream.save(tmp_path / "a.rrd")
    stream.set_time("stamp", timestamp=np.datetime64(5, "ns"))
    stream.set_time("frame", sequence=0)
    stream.log("/points", rr.Points3D(np.ones((4, 3))))
    stream.disconnect()
    with pytest.raises(InvalidInput, match="a.rrd has no description of its sensor"):
        Recorded(tmp_path / "a.rrd")
    with RecordingWriter(tmp_path / "b.rrd", ball[1]) as writer:
        writer.log_scalars(0, {"points": 1}, 0)
    with pytest.raises(InvalidInput, match="b.rrd has no clouds at /points"):
        Recorded(tmp_path / "b.rrd")


def test_the_sensor_is_found_again(recorded, ball, tmp_path):
    sensor, other = recorded.sensor, ball[1].replace(projection=AngularScan(0, 0.01, 0, 0.02))
    assert sensor.same_as(ball[1])
    for k, irf in enumerate((other.irf, np.tile(other.irf, (40 * 48, 1)))):         # the second: one for each pixel
        with RecordingWriter(tmp_path / f"{k}.rrd", other.replace(irf=irf)) as writer:
            writer.log_cloud(5, 0, ball[0].xyz, ball[0].intensity)
        found = Recorded(tmp_path / f"{k}.rrd").sensor
        assert found.replace(irf=other.irf).same_as(other) and np.allclose(found.irf, other.irf, rtol=1e-4)


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
    picture, length_m = draw_way(Recorded(tmp_path / "a.rrd"), WIDTH, HEIGHT)
    assert np.isclose(length_m, 6)
    pixels = np.asarray(picture).astype(int)
    rows, cols = np.nonzero(pixels[..., 0] - pixels[..., 2] > 100)      # orange
    bright = np.nonzero((pixels.max(axis=2) > 60) & (pixels[..., 0] - pixels[..., 2] < 50))
    px_per_m = np.ptp(bright[0][bright[1] < WIDTH // 2]) / 10
    assert np.allclose([np.ptp(cols) / px_per_m, np.ptp(rows) / px_per_m], 3, atol=0.6)
    assert abs(cols.min() - WIDTH / 2) < 0.5 * px_per_m and abs(rows.max() - HEIGHT / 2) < 0.5 * px_per_m
    below = pixels[int(HEIGHT / 2 + px_per_m):int(HEIGHT / 2 + 3 * px_per_m), WIDTH // 2 - 20:WIDTH // 2 + 20]
    assert below.max() < 60


def test_rays_are_drawn_in_a_picture_of_their_own(tmp_path, ball, recorded, monkeypatch):
    monkeypatch.setattr(gallery, "_LARGE_PX", (300, 175))
    cloud, sensor = ball
    ends = (1.5 * np.abs(cloud.xyz).max() * sensor.rays[::4, ::4].reshape(-1, 3)).astype(np.float32)
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        writer.log_cloud(0, 0, cloud.xyz, cloud.intensity)
        writer.log_free(0, 0, ends)
    fanned = Recorded(tmp_path / "a.rrd")
    for each, expected in ((fanned, True), (recorded, False)):
        write_report(each, summarise(each), tmp_path / "a.html")
        assert ("What is empty" in (tmp_path / "a.html").read_text()) == expected
    style, (one,) = gallery.CloudStyle.of(cloud, sensor), fanned.clouds()
    rays, none = (np.asarray(draw_fan(fanned, one, to, style, 300, 175)).astype(int) for to in (ends, 0 * ends))
    bluish = [(picture[..., 2] > picture[..., 0] + 12) & (picture[..., 2] < 230) for picture in (rays, none)]
    assert bluish[0].sum() > bluish[1].sum() + 2000
