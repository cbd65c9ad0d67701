"""RecordingReader: order, and one clear line for a file that is no recording of ours."""

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.reader import LogLine, RecordingReader
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


def test_optional_components_images_logs_and_properties_are_read_where_they_are(tmp_path):
    stream = rr.RecordingStream("srt3d_ros")
    stream.save(tmp_path / "a.rrd")
    stream.set_time("stamp", timestamp=np.datetime64(7, "ns"))
    stream.set_time("frame", sequence=3)
    half = pa.array(np.float32([0.5, 2]))
    stream.log("/points", rr.Points3D(np.ones((2, 3), np.float32), colors=np.zeros(2, np.uint32)),
               rr.AnyValues(intensity=half, depth_std=half, row=pa.array(np.uint16([7, 8]))))
    counts = np.arange(6).reshape(2, 3)
    stream.log("/photons", rr.DepthImage(counts.astype(np.uint8)))
    stream.log("/intensity", rr.DepthImage(counts.astype(np.float32)))
    stream.log("/background", rr.DepthImage(counts.astype(np.uint32)))
    stream.log("/log/sketcher", rr.TextLog("a line", level="WARN"))
    stream.send_property("versions", rr.AnyValues(numpy="2.4"))
    stream.disconnect()
    reader = RecordingReader(tmp_path / "a.rrd")
    (cloud,) = reader.clouds()
    assert cloud.intensity.tolist() == [0.5, 2] and cloud.intensity.dtype == cloud.depth_std_m.dtype == np.float32
    assert cloud.depth_std_m.tolist() == [0.5, 2] and cloud.row.tolist() == [7, 8] and cloud.col is None
    assert [(stamp, frame) for stamp, frame, _ in reader.images("/photons")] == [(7, 3)]
    assert [np.array_equal(image, counts) for name in ("/photons", "/intensity", "/background")
            for *_, image in reader.images(name)] == [True] * 3
    assert list(reader.images("/depth")) == []
    assert reader.log_lines() == [LogLine(7, "WARN", "a line")]
    assert reader.properties()["versions"] == {"numpy": "2.4"}


def test_clouds_of_another_program_without_intensities_give_one_line(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.save(tmp_path / "other.rrd")
    stream.set_time("stamp", timestamp=np.datetime64(0, "ns"))
    stream.set_time("frame", sequence=0)
    stream.log("/points", rr.Points3D(np.ones((3, 3), np.float32), colors=np.zeros(3, np.uint32)))
    stream.disconnect()
    with pytest.raises(InvalidInput, match="/points has no intensity"):
        list(RecordingReader(tmp_path / "other.rrd").clouds())
