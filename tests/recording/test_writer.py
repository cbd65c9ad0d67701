"""RecordingWriter: what is logged is in the file, and whatever happens to the file, the caller goes on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.pictures.colours import RANGE_TABLE, packed, shaded
from srt3d_ros.recording import entities
from srt3d_ros.recording import writer as writer_module
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.writer import STAMPS_KEPT, FrameIndex, RecordingFailed, RecordingWriter
from tests.recording.conftest import logged
from tools.processes import DEADLINE_S

SENSOR = SensorModel(2, 3, 50, 1e-10, np.ones(3))


def random_cloud(points, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(points, 3)).astype(np.float32), rng.gamma(2, 5, points).astype(np.float32)


def test_clouds_and_images_are_kept_as_they_were_when_logged(tmp_path, ball):
    """Arrays may be reused afterwards, and need not be contiguous."""
    rng, (ball, sensor) = np.random.default_rng(0), ball
    clouds = [rng.gamma(2, 5, (n, 4)).astype(np.float32) for n in (1000, 1, 0, 20_000)]
    clouds[0][3], image = np.nan, rng.gamma(2, 50, (30, 40)).astype(np.float32)
    image[3, 4] = np.nan
    counts = [rng.poisson(9, (30, 40)), np.full((30, 40), 70_000)]
    full = {"depth_std": ball.depth_std_bins, "row": ball.row, "col": ball.col, "surface": ball.surface}
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        for k, cloud in enumerate(map(np.copy, clouds)):
            writer.log_cloud(10**18 + k, 7 * k, cloud[:, :3], cloud[:, 3])
            cloud[:] = 99
        writer.log_cloud(10**18 + 4, 28, ball.xyz, ball.intensity, **full)
        for path in (entities.DEPTH_PATH, entities.INTENSITY_PATH):
            writer.log_image(path, 0, 0, reused := image.copy())
            reused[:] = 99
        for k, count in enumerate(counts):
            writer.log_image(entities.PHOTONS_PATH, k, k, count)
    reader = RecordingReader(tmp_path / "a.rrd")
    *read, last = sorted(reader.clouds(), key=lambda cloud: cloud.frame_index)
    for k, (cloud, kept) in enumerate(zip(clouds, read, strict=True)):
        assert (kept.stamp_ns, kept.frame_index) == (10**18 + k, 7 * k) and kept.more == {}
        assert np.array_equal(np.column_stack([kept.xyz, kept.intensity]), cloud, equal_nan=True)
    for name, wanted in full.items():
        assert np.array_equal(last.more[name], wanted) and last.more[name].dtype == wanted.dtype, name
    for path in (entities.DEPTH_PATH, entities.INTENSITY_PATH):
        ((_, _, read),) = reader.images(path)
        assert np.array_equal(read, image, equal_nan=True)
    read = sorted((image for image in reader.images(entities.PHOTONS_PATH)), key=lambda image: image[1])
    assert all(np.array_equal(image, count) for (_, _, image), count in zip(read, counts, strict=True))


def test_near_points_are_yellow_far_ones_blue_and_weak_ones_darker(tmp_path):
    xyz, _ = random_cloud(1000)
    weak = np.arange(1000) % 2 == 0
    with RecordingWriter(tmp_path / "a.rrd", SENSOR) as writer:
        writer.log_cloud(0, 0, xyz, np.where(weak, 5, 50))
    (cloud,) = RecordingReader(tmp_path / "a.rrd").clouds()
    range_m = np.linalg.norm(xyz, axis=1)
    near, far = np.percentile(range_m, (2, 98))
    for level, shown in ((0, weak), (255, ~weak)):
        table = packed(shaded(RANGE_TABLE, np.full(256, level)))
        assert set(cloud.colour[shown & (range_m < near)]) == {table[0]}
        assert set(cloud.colour[shown & (range_m > far)]) == {table[255]}
        assert set(cloud.colour[shown]) <= set(table)


def test_poses_are_kept_and_the_room_stands_where_the_sensor_saw_it(tmp_path, ball):
    cloud, sensor = ball
    poses = [Pose(Pose.turned([0, 0, 0.3 * k]).rotation, np.array([0.5 * k, 0, 1])) for k in range(3)]
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        writer.log_cloud(0, 0, cloud.xyz, cloud.intensity)      # before odometry has come
        for k, pose in enumerate(poses):
            writer.log_cloud(10**8 * (k + 1), k + 1, cloud.xyz, cloud.intensity)
            writer.log_pose(10**8 * (k + 1), k + 1, pose)
            writer.log_room(10**8 * (k + 1), k + 1, pose, cloud.xyz, cloud.intensity)
    reader = RecordingReader(tmp_path / "a.rrd")
    for pose, (frame, kept) in zip(poses, reader.poses().items(), strict=True):
        assert poses[frame - 1] is pose
        wanted = [*pose.translation, *pose.quaternion]
        np.testing.assert_allclose([*kept.translation, *kept.quaternion], wanted, atol=1e-6)
    assert all(np.array_equal(one.xyz, cloud.xyz) for one in reader.clouds())       # in the sensor's frame
    for pose, room in zip(poses, logged(tmp_path / "a.rrd", "/room", "Points3D:positions"), strict=True):
        np.testing.assert_allclose(room, pose(cloud.xyz), atol=1e-5)
    assert logged(tmp_path / "a.rrd", "/points", "CoordinateFrame:frame") == [["tf#/pose"]]


def test_images_come_five_times_a_second_of_stamps_at_most():
    def chosen(*stamps_ms) -> list[float]:
        frames = FrameIndex()
        return [ms for ms in stamps_ms if frames[round(ms * 1e6)].has_images]

    jitter_ms = np.random.default_rng(1).uniform(-3, 3, 1000)
    for rate_hz, least_hz in ((3, 3), (5, 5), (7.3, 3.6), (10, 5), (30, 5), (100, 5)):
        seconds = 1000 / rate_hz
        kept = chosen(*(np.arange(1000) / 1000 * seconds * 1e3 + jitter_ms + 1000))
        assert 0.99 * least_hz * seconds < len(kept) <= 5 * seconds + 1, rate_hz
    assert chosen(5000, 5100, 0, 100, 200) == [5000, 0, 200]      # a bag that begins again


def test_depth_is_yellow_when_near_and_black_where_there_is_none(ball):
    """The viewer turns its map round for a range that falls, and draws one image over the other."""
    depth_m = ball[0].depth_image()
    drawn = entities.image(entities.DEPTH_PATH, depth_m, 1.0, 1.5)
    (image,), (mask,) = drawn[entities.DEPTH_PATH], drawn[entities.NO_DEPTH]
    assert image.depth_range.as_arrow_array()[0].as_py() == pytest.approx((1.5 + 0.5 * 45 / 210, 1.0))
    black = np.array(mask.buffer.as_arrow_array()[0].as_py()).reshape(depth_m.shape) == 1
    assert np.array_equal(black, np.isnan(depth_m)) and mask.opacity.as_arrow_array()[0].as_py() == 1.0


@pytest.mark.filterwarnings("ignore")       # of a missing footer
def test_a_flood_of_clouds_does_not_keep_scalars_from_the_file(tmp_path, monkeypatch):
    """Without regular flushes, rerun writes clouds only."""
    monkeypatch.setattr(writer_module, "FLUSH_PERIOD_S", 0.0)       # with every cloud
    (xyz, intensity), written = random_cloud(100_000), set()
    with RecordingWriter(tmp_path / "a.rrd", SENSOR) as writer:
        writer.log_scalars(0, {"points": 1}, 0)
        for k in range(10):
            writer.log_cloud(k, k, xyz, intensity)
        (tmp_path / "copy.rrd").write_bytes((tmp_path / "a.rrd").read_bytes())
    for chunk in RrdReader(tmp_path / "copy.rrd").stream().filter(content="/metrics/**", is_static=False):
        written.add(chunk.entity_path)
    assert written == {"/metrics/points"}


def test_a_path_that_cannot_be_written_is_one_line_and_no_file_is_replaced(tmp_path):
    (tmp_path / "a.rrd").write_bytes(b"older")
    for name, why in (("absent/a.rrd", "No such file or directory"), ("a.rrd", "File exists")):
        with pytest.raises(RecordingFailed) as caught:
            RecordingWriter(tmp_path / name, SENSOR)
        assert str(caught.value) == f"recording {tmp_path}/{name}: {why}"
    assert (tmp_path / "a.rrd").read_bytes() == b"older"


def test_a_process_that_forgets_to_close_ends_with_a_finished_file(tmp_path):
    script = """
import sys
import numpy as np
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.recording.writer import RecordingWriter
writer = RecordingWriter(sys.argv[1], SensorModel(2, 3, 50, 1e-10, np.ones(3)))
for k in range(30):
    writer.log_cloud(k, k, np.ones((20_000, 3)), np.ones(20_000))
"""
    subprocess.run([sys.executable, "-c", script, tmp_path / "a.rrd"], timeout=DEADLINE_S, check=True)
    reader = RecordingReader(tmp_path / "a.rrd")
    assert len(list(reader.clouds())) == 30


HANGING_DISK = """
import os, sys
import numpy as np
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros import compat
from srt3d_ros.recording import writer

def create_file(path):
    global end
    os.mkfifo(path)
    end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)        # which nobody reads from

writer.FLUSH_TIMEOUT_S = writer.END_TIMEOUT_S = 0.5
compat.create_rerun_file = create_file
one = writer.RecordingWriter(sys.argv[1], SensorModel(2, 3, 50, 1e-10, np.ones(3)))
try:
    while True:
        one.log_cloud(1, 0, np.zeros((10_000, 3)), np.zeros(10_000))
except writer.RecordingFailed as error:
    print(error, flush=True)
one.close()
"""


def test_a_disk_that_hangs_gives_one_error_and_does_not_keep_the_process_from_ending(tmp_path):
    done = subprocess.run([sys.executable, "-c", HANGING_DISK, str(tmp_path / "a.rrd")], capture_output=True, text=True,
                          timeout=DEADLINE_S)
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    assert done.stdout == f"recording {tmp_path / 'a.rrd'}: Flush timed out - not all log messages were sent\n"


def test_closing_twice_changes_nothing(tmp_path):
    writer = RecordingWriter(tmp_path / "a.rrd", SENSOR)
    writer.log_scalars(3, {"ppp": 1, "points": None}, 8)
    writer.log_scalars(4, {"ppp": np.int64(2), "points": float("nan")}, 9)
    writer.close()
    size = (tmp_path / "a.rrd").stat().st_size
    writer.close()
    series = RecordingReader(tmp_path / "a.rrd").series
    assert series["ppp"].values.tolist() == [1, 2] and series["ppp"].stamp_ns.tolist() == [3, 4]
    assert len(series["points"].values) == 1 and np.isnan(series["points"].values[0])
    assert (tmp_path / "a.rrd").stat().st_size == size


@pytest.mark.filterwarnings("error")
def test_properties_hold_what_is_given_last_and_none_without_facts(tmp_path):
    facts = {"version": "1.2", "frequencies": [1, 2, 5], "nothing": None, "path": tmp_path, "rate_hz": 10.0,
             "live": True}
    with RecordingWriter(tmp_path / "a.rrd", SENSOR, properties={"run": facts, "empty": {}}) as writer:
        writer.set_properties("unset", {"unset": None, "none": [], "nothing": ()})
        writer.set_properties("parameters", {"sketcher.sketch_size": 5, "sketcher.layout": "float32"})
        writer.set_properties("parameters", {"sketcher.sketch_size": 6})
    properties = RecordingReader(tmp_path / "a.rrd").properties
    run = properties["run"]
    assert not {"empty", "unset"} & properties.keys()
    assert run["frequencies"].tolist() == [1, 2, 5] and run["path"] == str(tmp_path) and "nothing" not in run
    assert (run["version"], run["rate_hz"], run["live"]) == ("1.2", 10.0, True)
    assert properties["parameters"] == {"sketcher.sketch_size": 6, "sketcher.layout": "float32"}


def threads_of_streams() -> int:
    """Number of threads of rerun's streams in this process."""
    comms = [path.read_text() for path in Path("/proc/self/task").glob("*/comm")]
    return sum(comm.startswith(("ChunkBatcher", "RecordingStream")) for comm in comms)


def test_a_recording_is_one_whole_file_and_leaves_no_threads_behind(tmp_path, ball):
    """Without compat, rerun keeps two threads for each file and two for its blueprint."""
    before = threads_of_streams()
    with RecordingWriter(tmp_path / "a.rrd", ball[1], {"run": {"namespace": "/"}}) as writer:
        writer.log_cloud(0, 0, *random_cloud(10))
    assert threads_of_streams() <= before
    properties = RecordingReader(writer.path).properties
    assert properties["run"]["namespace"] == "/" and '"rows":40' in properties["sensor"]["description"]
    assert len(RrdReader(writer.path).blueprints()) == 1
    static = {chunk.entity_path for chunk in RrdReader(writer.path).stream().filter(content="/**", is_static=True)}
    assert {"/", "/sensor", "/metrics/points"} <= static


def test_a_disk_that_is_nearly_full_ends_the_recording_with_one_line_and_a_whole_file(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "a.rrd", SENSOR)
    writer.log_cloud(0, 0, *random_cloud(10))
    writer.flush()
    monkeypatch.setattr(writer_module, "LEAST_FREE_BYTES", 10**18)
    with pytest.raises(RecordingFailed, match="stopped, as the disk has only"):
        writer.flush()
    writer.close()
    assert len(list(RecordingReader(tmp_path / "a.rrd").clouds())) == 1


def test_frames_count_up_by_their_stamps_at_the_rate_of_the_last_clouds():
    frames = FrameIndex()
    assert [frames[stamp].number for stamp in (10, 30, 20, 30)] == [0, 1, 2, 1]
    for stamp in range(100, 100 + STAMPS_KEPT):
        last = frames[stamp]
    assert last.number == 2 + STAMPS_KEPT and frames[10].number == last.number + 1
    frames = FrameIndex()
    rates = [frames.cloud_came(frames[stamp * 10**8]) for stamp in range(20)]
    assert rates[0] is None and rates[1:] == pytest.approx([10.0] * 19)
