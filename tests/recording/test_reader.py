"""RecordingReader: order, and one clear line for a file that is no recording of ours."""

import numpy as np
import pytest
import rerun as rr

from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.writer import RecordingWriter


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.rrd"
    with RecordingWriter(path, None) as writer:
        for k in (2, 0, 1):
            writer.log_cloud(k, k, np.full((500, 3), k), np.full(500, k))
            writer.log_scalars(k, {"points": 10 + k}, k)
    return path


def test_clouds_come_as_logged_and_series_in_the_order_of_their_stamps(whole):
    reader = RecordingReader(whole)
    assert [cloud.frame_index for cloud in reader.clouds()] == [2, 0, 1]
    assert reader.series()["points"].stamp_ns.tolist() == [0, 1, 2]
    assert reader.series()["points"].values.tolist() == [10, 11, 12]
    assert reader.application_id == "srt3d_ros"


def test_a_recording_without_a_frame_is_empty_not_broken(tmp_path):
    RecordingWriter(tmp_path / "a.rrd", None).close()
    reader = RecordingReader(tmp_path / "a.rrd")
    assert reader.is_finished()
    assert list(reader.clouds()) == [] and list(reader.depth_images()) == []
    assert reader.series() == {} and reader.properties() == {}


@pytest.mark.parametrize("damage, expected", [
    (lambda data: b"", "too small"),
    (lambda data: b"row,col,toa\n" * 100, "Not an RRD file"),
    (lambda data: data[:200], "a whole .rrd file"),
    (lambda data: data[:-1000], "exceeds file size"),
])
def test_a_damaged_file_gives_one_line(tmp_path, whole, damage, expected):
    path = tmp_path / "bad.rrd"
    path.write_bytes(damage(whole.read_bytes()))
    with pytest.raises(InvalidInput, match=expected) as caught:
        list(RecordingReader(path).clouds())
    assert str(caught.value).startswith("recording is ") and "\n" not in str(caught.value)


def test_a_missing_file_gives_one_line(tmp_path):
    with pytest.raises(InvalidInput, match="recording is .*absent.rrd: expected an .rrd file that exists"):
        RecordingReader(tmp_path / "absent.rrd")


def test_clouds_of_another_program_without_intensities_give_one_line(tmp_path):
    stream = rr.RecordingStream("other", recording_id="other")
    stream.save(tmp_path / "other.rrd")
    stream.set_time("stamp", timestamp=np.datetime64(0, "ns"))
    stream.set_time("frame", sequence=0)
    stream.log("/points", rr.Points3D(np.ones((3, 3), np.float32), colors=np.zeros(3, np.uint32)))
    stream.disconnect()
    with pytest.raises(InvalidInput, match="/points with intensity"):
        list(RecordingReader(tmp_path / "other.rrd").clouds())
