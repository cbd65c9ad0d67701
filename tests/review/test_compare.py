"""Two recordings compared: which frames belong together, and how far apart their clouds are."""

import numpy as np
import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.review.compare import compare, format_comparison, nearest_mm
from srt3d_ros.review.recorded import Recorded


@pytest.fixture
def other(tmp_path, ball, write_recording):
    """Record the ball again, changed as the options say."""
    def call(**options):
        write_recording(tmp_path / "other.rrd", *ball, **options)
        return Recorded.read(tmp_path / "other.rrd")
    return call


def test_a_recording_is_identical_with_itself(recorded):
    found = compare(recorded, recorded)
    assert found["matched_by"] == "stamp" and found["frames"] == found["identical_frames"] == len(recorded.index)
    assert found["distance_mm"]["worst frame"] == {"mean": 0, "median": 0, "p95": 0}
    assert found["latency_ms"]["first"] == found["latency_ms"]["second"]
    assert found["points_difference"] == {"median": 0, "min": 0, "max": 0}


def test_a_shift_is_found_and_frames_match_by_stamp(recorded, other):
    found = compare(recorded, other(shift_m=0.001, missing=(0, 1)))
    assert found["matched_by"] == "stamp" and found["frames"] == 26
    assert found["only_in_first"] == 2 and found["only_in_second"] == 2
    assert 0.3 < found["distance_mm"]["median frame"]["median"] <= 1.001 and found["identical_frames"] == 0


def test_without_common_stamps_frames_match_by_index_and_points_are_compared_with_their_sign(recorded, other):
    found = compare(recorded, other(first_ns=7, frames=14, frame_offset=1))
    assert found["matched_by"] == "frame" and found["frames"] == 12
    assert found["points_difference"]["min"] == -90 and found["points_difference"]["max"] == 89
    assert "no stamp is in both" in format_comparison(found)


def test_distances_are_those_of_both_directions_in_millimetres():
    ours, theirs = np.array([[0, 0, 0], [0, 0, 1.0]]), np.array([[0, 0, 0.001]])
    mean, median, _, most = nearest_mm(ours, theirs)
    assert mean == pytest.approx((1 + 999 + 1) / 3) and median == pytest.approx(1) and most == pytest.approx(999)
    assert nearest_mm(ours, np.empty((0, 3))) is None
    assert nearest_mm(ours, np.array([[np.nan, 0, 0], [0, 0, 0]]))[1] == 0


def test_recordings_that_share_no_frame_are_one_line(recorded, other):
    with pytest.raises(InvalidInput, match="holds too, by stamp or by index"):
        compare(recorded, other(first_ns=7, frame_offset=1000))
