"""RecordingReader: order, and one clear line for a file that is no recording of ours."""

import numpy as np
import pytest
import rerun as rr

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.writer import RecordingWriter

SENSOR = SensorModel(2, 3, 50, 1e-10, np.ones(3))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.rrd"
    with RecordingWriter(path, SENSOR) as writer:
        for k in (2, 0, 1):
            writer.log_cloud(k, k, np.full((500, 3), k), np.full(500, k))
            writer.log_scalars(k, {"points": 10 + k}, k)
    return path


def test_clouds_come_as_logged_and_series_and_index_sorted_by_stamp(whole):
    reader, index = RecordingReader(whole), RecordingReader(whole).cloud_index()
    assert [cloud.frame_index for cloud in reader.clouds()] == [2, 0, 1]
    assert [cloud.frame_index for cloud in reader.clouds({1})] == [1]
    assert index.stamp_ns.tolist() == index.frame_index.tolist() == [0, 1, 2] and index.points.tolist() == [500] * 3
    assert reader.series()["points"].stamp_ns.tolist() == [0, 1, 2]
    assert reader.series()["points"].values.tolist() == [10, 11, 12]


def test_a_recording_without_a_frame_is_empty_not_broken(tmp_path):
    RecordingWriter(tmp_path / "a.rrd", SENSOR).close()
    reader = RecordingReader(tmp_path / "a.rrd")
    assert list(reader.clouds()) == [] and list(reader.images("/depth")) == []
    assert reader.series() == {} and reader.log_lines() == []


def with_version(data, minor):
    return data[:5] + bytes([minor]) + data[6:]


@pytest.mark.parametrize("damage, expected", [
    (lambda data: data[:7], "bad.rrd is cut off"),
    (lambda data: data[:-1000], "`rerun rrd filter --continue-on-error -o saved.rrd bad.rrd` saves what can be read"),
    (lambda data: with_version(data, 250), "was written by rerun 0.250.0; rerun 0.41.* reads 0.23 to 0.41"),
    (lambda data: b"RRF3" + data[4:], "pip install -U rerun-sdk, or `rerun rrd migrate`"),
    (lambda data: data[:500] + bytes(len(data) - 600) + data[-100:], "^Cannot read recording .*bad.rrd"),
])
def test_a_damaged_foreign_or_newer_file_gives_one_line(tmp_path, whole, damage, expected):
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
