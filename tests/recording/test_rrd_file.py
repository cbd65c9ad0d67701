"""A recording that was cut off: copied but for the chunk that was cut."""

import random
import struct

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


def chunks(data):
    """Where each chunk begins, and its length."""
    begin, chunk = 12, 2
    while begin + 16 <= len(data):
        kind, length = struct.unpack_from("<QQ", data, begin)
        if kind == chunk:
            yield begin + 16, length
        begin += 16 + length


def copied(cut):
    """The path of a copy of what can be read."""
    copy = cut.with_name("copy.rrd")
    copy_readable(cut, copy)
    return copy


def test_random_truncations_lack_at_most_one_chunk(tmp_path, whole):
    data, cut = whole.read_bytes(), tmp_path / "cut.rrd"
    before = clouds_in(whole)
    assert is_finished(whole)
    rng = random.Random(5)
    for size in [rng.randrange(len(data) // 20, len(data)) for _ in range(4)]:
        cut.write_bytes(data[:size])
        copy = copied(cut)
        assert cut.read_bytes() == data[:size] and not is_finished(cut) and is_finished(copy)
        kept = clouds_in(copy)
        assert len(RrdReader(copy).blueprints()) == 1
        assert sorted(kept) == list(range(len(kept)))           # nothing is missing but the end
        # All whole chunks are kept: what is lost is what the file held of one that is not whole.
        ends = [begin + length for begin, length in chunks(data) if begin + length <= size]
        cut.write_bytes(data[:ends[-1]])
        assert clouds_in(cut).keys() == kept.keys()
        assert all(np.array_equal(ours, theirs) for k in kept for ours, theirs in zip(kept[k], before[k]))


def test_a_chunk_that_cannot_be_read_is_left_out_and_a_tail_of_zeros_as_a_power_cut_leaves_it(tmp_path, whole):
    data, cut = bytearray(whole.read_bytes()[:-2000] + bytes(5000)), tmp_path / "cut.rrd"
    cut.write_bytes(data)
    before = clouds_in(copied(cut))
    begin, _ = max(chunks(data), key=lambda chunk: chunk[1])        # a cloud
    data[begin:begin + 300] = bytes(255 - b for b in data[begin:begin + 300])
    cut.write_bytes(data)
    kept = clouds_in(copied(cut))
    assert len(before) - FRAMES // 4 < len(kept) < len(before)
