"""A recording that was cut off: repaired into a copy from which at most the chunk that was cut is missing."""

import random
import struct
import subprocess

import numpy as np
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.repair import examine, repair
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


def test_random_truncations_open_after_repair_and_lack_at_most_one_chunk(tmp_path, whole):
    data, cut = whole.read_bytes(), tmp_path / "cut.rrd"
    before = clouds_in(whole)
    assert examine(whole)
    rng = random.Random(5)
    for size in [rng.randrange(len(data) // 20, len(data)) for _ in range(4)]:
        cut.write_bytes(data[:size])
        copy = repair(cut)
        assert copy == tmp_path / "cut_repaired.rrd" and cut.read_bytes() == data[:size]
        assert not examine(cut) and examine(copy) and sorted(tmp_path.iterdir()) == [cut, copy]
        kept = clouds_in(copy)
        assert len(RrdReader(copy).blueprints()) == 1
        assert sorted(kept) == list(range(len(kept)))           # nothing is missing but the end
        # All whole chunks are kept: what is lost is what the file held of one that is not whole.
        ends = [begin + length for begin, length in chunks(data) if begin + length <= size]
        cut.write_bytes(data[:ends[-1]])
        assert clouds_in(cut).keys() == kept.keys()
        assert all(np.array_equal(ours, theirs) for k in kept for ours, theirs in zip(kept[k], before[k]))


def test_a_tail_of_zeros_as_a_power_cut_leaves_it_is_cut_off(tmp_path, whole):
    data, cut = whole.read_bytes(), tmp_path / "cut.rrd"
    ends = [begin + length for begin, length in chunks(data)]
    cut.write_bytes(data[:ends[len(ends) // 2]] + bytes(5000))
    assert clouds_in(repair(cut))


def test_a_chunk_that_cannot_be_read_is_left_out(tmp_path, whole):
    data, cut = bytearray(whole.read_bytes()[:-2000]), tmp_path / "cut.rrd"
    cut.write_bytes(data)
    before = clouds_in(repair(cut))
    begin, _ = max(chunks(data), key=lambda chunk: chunk[1])        # a cloud
    data[begin:begin + 300] = bytes(255 - b for b in data[begin:begin + 300])
    cut.write_bytes(data)
    kept = clouds_in(repair(cut))
    assert len(before) - FRAMES // 4 < len(kept) < len(before)


def test_a_full_disk_is_reported_and_leaves_no_copy(tmp_path, whole):
    data = whole.read_bytes()[:-2000]
    mount = ["mount", "-t", "tmpfs", "-o", f"size={len(data) + 100_000}", "tmpfs", str(tmp_path)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("a file system of a known size cannot be mounted here")
    try:
        cut = tmp_path / "cut.rrd"
        cut.write_bytes(data)
        with pytest.raises(InvalidInput, match="room on the disk for a repaired copy beside it"):
            repair(cut)
        assert list(tmp_path.iterdir()) == [cut]
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


def test_where_nothing_can_be_written_one_line_says_so(whole, monkeypatch):
    monkeypatch.setattr("srt3d_ros.recording.repair.os.access", lambda *_: False)     # root may write anywhere
    with pytest.raises(InvalidInput, match="a folder that can be written for a repaired copy"):
        repair(whole)
