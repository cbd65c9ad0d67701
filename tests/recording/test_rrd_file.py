"""A recording that was cut off: copied but for the chunk that was cut."""

import numpy as np
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.rrd_file import copy_readable, is_finished
from srt3d_ros.recording.writer import RecordingWriter

FRAMES, POINTS = 40, 300


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of FRAMES clouds, flushed after each: many chunks."""
    path = tmp_path_factory.mktemp("whole") / "a.rrd"
    with RecordingWriter(path, None) as writer:
        for k in range(FRAMES):
            rng = np.random.default_rng(k)
            writer.log_cloud(k * 10**8, k, rng.normal(size=(POINTS, 3)), rng.uniform(1, 9, POINTS))
            writer.log_scalars(k * 10**8, {"points": POINTS}, k)
            writer.flush()
    return path


def clouds_in(path):
    """{frame: (xyz, intensity)}"""
    return {cloud.frame_index: (cloud.xyz, cloud.intensity) for cloud in RecordingReader(path).clouds()}


def test_what_was_cut_off_lacks_only_its_end(tmp_path, whole):
    data, cut, copy = whole.read_bytes(), tmp_path / "cut.rrd", tmp_path / "copy.rrd"
    before, last = clouds_in(whole), 0
    assert is_finished(whole)
    for share in (0.3, 0.6, 0.9):
        size = round(share * len(data))
        cut.write_bytes(data[:size] + bytes(5000) * (share == 0.9))         # with zeros, as a power cut leaves it
        copy_readable(cut, copy)
        assert cut.read_bytes()[:size] == data[:size] and not is_finished(cut) and is_finished(copy)
        kept = clouds_in(copy)
        assert len(RrdReader(copy).blueprints()) == 1
        assert sorted(kept) == list(range(len(kept))) and len(kept) > max(last, (share - 0.15) * FRAMES)
        assert all(np.array_equal(ours, theirs) for k in kept for ours, theirs in zip(kept[k], before[k]))
        last = len(kept)
