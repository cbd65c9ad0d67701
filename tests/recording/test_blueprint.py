"""Recordings as they are read: their order, blueprint and eye, and one line for a file that is none of ours."""


import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.errors import InvalidInput
from srt3d_ros.pictures.viewpoint import LEVEL, look_at
from srt3d_ros.recording import entities
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.writer import RecordingWriter
from tests.recording.conftest import logged


def blueprint_columns(path):
    """Every logged component of the file's blueprint, as {name: [values]}."""
    reader = RrdReader(path)
    (blueprint,) = reader.blueprints()
    found = {}
    for chunk in reader.stream(store=blueprint):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if "timestamp" not in str(batch.column(name).type):
                found.setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


def test_film_plays_cloud_images_and_plots_by_frames_at_the_speed_of_the_stamps(tmp_path, ball):
    with RecordingWriter(tmp_path / "a.rrd", ball[1], images=(entities.DEPTH_PATH, entities.BACKGROUND_PATH)) as writer:
        for k in range(3):
            writer.log_cloud(k * 10**8, k, ball[0].xyz, ball[0].intensity)
    columns = blueprint_columns(tmp_path / "a.rrd")
    origins = {origin for (origin,) in columns["ViewBlueprint:space_origin"]}
    assert origins == {"/", "/depth", "/background", "/metrics"}         # views of the recorded images only
    eye = look_at(ball[0].xyz, ball[1].projection, fov_deg=55, aspect=1.2)
    (position,), (target,) = columns["EyeControls3D:position"][-1], columns["EyeControls3D:look_target"][-1]
    assert np.allclose(position, eye.position) and np.allclose(target, eye.target)
    assert ["frame"] in columns["TimePanelBlueprint:timeline"] and [10] in columns["TimePanelBlueprint:fps"]


def test_empty_rays_start_at_the_sensor_are_few_and_are_hidden_at_first(tmp_path, ball):
    ends = np.random.default_rng(0).normal(size=(4000, 3)).astype(np.float32)
    with RecordingWriter(tmp_path / "a.rrd", ball[1]) as writer:
        writer.log_cloud(0, 0, ball[0].xyz, ball[0].intensity)
        writer.log_free(0, 0, ends)
        writer.log_free(10**8, 1, ends[:0])
    strips = logged(tmp_path / "a.rrd", entities.FREE_PATH, "LineStrips3D:strips")
    assert [len(each) for each in strips] == [286, 0]
    assert np.allclose(strips[0][1], [np.zeros(3), ends[14]])
    assert [False] in blueprint_columns(tmp_path / "a.rrd")["EntityBehavior:visible"]


def test_the_view_of_a_sensor_that_moves_stands_and_shows_the_room_of_the_last_ten_seconds(tmp_path, ball):
    cloud, sensor = ball
    walls = np.array([[x, y, z] for x in (-9, 9) for y in (-9, 9) for z in (0, 3)], np.float32)
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        for k in range(3):
            writer.log_cloud(k * 10**8, k, cloud.xyz, cloud.intensity)
            writer.log_pose(k * 10**8, k, Pose())
            writer.log_room(k * 10**8, k, Pose(), walls, np.ones(8, np.float32))
    columns = blueprint_columns(tmp_path / "a.rrd")
    (target,), (position,) = columns["EyeControls3D:look_target"][-1], columns["EyeControls3D:position"][-1]
    eye = look_at(np.tile(walls, (3, 1)), None, 30, 40, 55, 1.2, LEVEL)
    assert np.allclose(position, eye.position) and np.allclose(target, eye.target) and position[2] > 9
    ranges = [(one["timeline"], one["range"]["start"], one["range"]["end"])
              for item in columns["VisibleTimeRanges:ranges"] if item for one in item]
    assert sorted(ranges) == [("frame", -100, -1), ("frame", -100, 0), ("stamp", -10**10, -10**8),
                              ("stamp", -10**10, 0)]


@pytest.mark.parametrize("scanner", [False, True])
def test_the_frustum_begins_at_the_sensor_and_reaches_to_the_cloud(tmp_path, ball, scanner):
    cloud, sensor = ball
    if scanner:
        sensor = sensor.replace(projection=AngularScan(0.4, -0.02, 0.4, -0.02))
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        writer.log_cloud(0, 0, cloud.xyz, cloud.intensity)
    (strips,) = logged(tmp_path / "a.rrd", "/sensor", "LineStrips3D:strips")
    border, *corners = map(np.array, strips)
    assert all((begin == 0).all() for begin, _ in corners)
    reach_m = np.linalg.norm([*border, *(end for _, end in corners)], axis=1)
    assert np.allclose(reach_m, np.percentile(np.linalg.norm(cloud.xyz, axis=1), 99), rtol=1e-5)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.rrd"
    with RecordingWriter(path, SensorModel(2, 3, 50, 1e-10, np.ones(3))) as writer:
        for k in (2, 0, 1):
            writer.log_cloud(k, k, np.full((500, 3), k), np.full(500, k))
            writer.log_scalars(k, {"points": 10 + k}, k)
    return path


def test_clouds_come_as_logged_series_sorted_by_stamp_and_what_was_not_logged_is_empty(whole):
    reader = RecordingReader(whole)
    assert [cloud.frame_index for cloud in reader.clouds()] == [2, 0, 1]
    assert [cloud.frame_index for cloud in reader.clouds({1})] == [1] and list(reader.images("/depth")) == []
    index, points = reader.index, reader.series["points"]
    assert index.stamp_ns.tolist() == index.frame_index.tolist() == [0, 1, 2] and index.points.tolist() == [500] * 3
    assert points.stamp_ns.tolist() == [0, 1, 2] and points.values.tolist() == [10, 11, 12] and reader.poses() == {}


@pytest.mark.parametrize("damage, expected", [
    (lambda data: data[:7], "bad.rrd is cut off"),
    (lambda data: data[:-1000], "`rerun rrd filter --continue-on-error -o saved.rrd bad.rrd` saves what can be read"),
    (lambda data: b"RRF3" + data[4:], "^Cannot read recording .*bad.rrd .Not an RRD file"),
    (lambda data: data[:500] + bytes(len(data) - 600) + data[-100:], "^Cannot read recording .*bad.rrd"),
])
def test_a_damaged_or_foreign_file_gives_one_line(tmp_path, whole, damage, expected):
    path = tmp_path / "bad.rrd"
    path.write_bytes(damage(whole.read_bytes()))
    with pytest.raises(InvalidInput, match=expected) as caught:
        list(RecordingReader(path).clouds())
    assert "bad.rrd" in str(caught.value) and "\n" not in str(caught.value)


def test_clouds_of_another_program_without_intensities_give_one_line(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.save(tmp_path / "other.rrd")
    stream.set_time("stamp", timestamp=np.datetime64(0, "ns"))
    stream.set_time("frame", sequence=0)
    stream.log("/points", rr.Points3D(np.ones((3, 3), np.float32), colors=np.zeros(3, np.uint32)))
    stream.disconnect()
    with pytest.raises(InvalidInput, match="/points has no intensity"):
        list(RecordingReader(tmp_path / "other.rrd").clouds())
