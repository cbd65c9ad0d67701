"""Recordings in several files: how they are named, that each is complete, and that nothing is between them."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

from srt3d_ros.recording.parts import PartNames, Split
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.writer import RecordingWriter

POINTS = 5000


def threads_of_streams() -> int:
    """Number of threads of rerun's streams in this process."""
    comms = [path.read_text() for path in Path("/proc/self/task").glob("*/comm")]
    return sum(comm.startswith(("ChunkBatcher", "RecordingStream")) for comm in comms)


def names(path, numbered, number=3):
    parts = PartNames(path, numbered)
    return [parts.next().name for _ in range(number)]


def test_numbers_go_on_after_the_last_file_there_is(tmp_path):
    assert names(tmp_path / "a.rrd", numbered=True) == ["a_001.rrd", "a_002.rrd", "a_003.rrd"]
    for other in ("a_007.rrd", "a_x.rrd", "ab_009.rrd", "a_0123.rrd.bak"):
        (tmp_path / other).touch()
    assert names(tmp_path / "a.rrd", numbered=True, number=1) == ["a_008.rrd"]


def test_a_single_file_has_the_name_that_was_given_and_later_ones_replace_nothing(tmp_path):
    for name in ("a.rrd", "a_2.rrd"):
        (tmp_path / name).touch()
    parts = PartNames(tmp_path / "a.rrd", numbered=False)
    assert parts.next().name == "a.rrd" and parts.next().name == "a_3.rrd"


def test_files_follow_each_other_by_size_or_by_age():
    assert not Split() and Split(size_mb=1) and Split(period_s=1)
    assert not Split().due(10**12, 1e9)
    assert Split(size_mb=2).due(2_000_000, 0) and not Split(size_mb=2).due(1_999_999, 1e9)
    assert Split(period_s=3).due(0, 3) and not Split(period_s=3).due(10**12, 2.9)


def test_a_file_that_is_finished_leaves_no_threads_behind(tmp_path):
    """Without rerun_streams, rerun keeps two for each file and two for its blueprint."""
    before = threads_of_streams()
    with RecordingWriter(tmp_path / "a.rrd", None, split=Split(size_mb=0.02)) as writer:
        while writer.parts < 5:
            writer.log_cloud(0, 0, np.random.default_rng(0).normal(size=(1000, 3)), np.ones(1000))
            writer.flush()
    assert threads_of_streams() <= before


def test_parts_are_complete_files_of_one_recording_without_a_frame_between_them(tmp_path, ball):
    sensor, split, frames = ball[1], Split(size_mb=0.5), 60
    rng = np.random.default_rng(0)
    properties = {"run": {"namespace": "/"}, "versions": {"numpy": "2"}}
    with RecordingWriter(tmp_path / "a.rrd", sensor, properties=properties, split=split) as writer:
        for k in range(frames):
            writer.log_cloud(k, k, rng.normal(size=(POINTS, 3)) + [0, 0, 5], rng.gamma(2, 5, POINTS))
            writer.log_scalars(k, {"points": POINTS}, k)
            if k == 0:
                writer.set_properties("parameters", {"sketcher.sketch_size": 5})
            time.sleep(0.03)
    paths = sorted(tmp_path.glob("*.rrd"))
    readers = [RecordingReader(path) for path in paths]
    assert len(paths) == writer.parts >= 3 and paths[0].name == "a_001.rrd" and writer.path == paths[-1]
    clouds = [cloud.frame_index for reader in readers for cloud in reader.clouds()]
    assert sorted(clouds) == list(range(frames)) and writer.dropped == 0
    assert sum(len(reader.series()["points"].values) for reader in readers) == frames
    for number, (reader, path) in enumerate(zip(readers, paths), start=1):
        properties = reader.properties()
        assert reader.is_finished and reader.recording_id == readers[0].recording_id
        assert properties["run"] == {"namespace": "/", "part": number} and properties["versions"]["numpy"] == "2"
        assert properties["sensor"]["rows"] == 40 and properties["parameters"]["sketcher.sketch_size"] == 5
        assert len(RrdReader(path).blueprints()) == 1
        static = {chunk.entity_path for chunk in RrdReader(path).stream().filter(content="/**", is_static=True)}
        assert {"/", "/sensor", "/metrics/points"} <= static
    sizes = [path.stat().st_size for path in paths[:-1]]
    assert max(sizes) < 3 * min(sizes)


FULL = """
import resource, sys, time
import numpy as np
from srt3d_ros.recording.writer import RecordingWriter
writer = RecordingWriter(sys.argv[1], None)
resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))        # a write then fails as on a full disk
while writer.error is None:
    writer.log_cloud(0, 0, np.ones((5000, 3)), np.ones(5000))
    time.sleep(0.01)
print(writer.error)
assert not writer.flush() and writer.dropped > 0
"""


def test_a_full_disk_lets_the_process_end(tmp_path):
    """With rerun's own file sink it would not. How it goes on once there is room: tests/nodes/test_recorder.py."""
    done = subprocess.run([sys.executable, "-c", FULL, tmp_path / "a.rrd"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"recording {tmp_path / 'a.rrd'}: File too large\n", "")
