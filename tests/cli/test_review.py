"""`srt3d review`: what it prints and writes; a broken file is repaired into a copy, a foreign one is one line."""

import json
import subprocess
import sys

import numpy as np
import pytest

from srt3d_ros.recording.writer import RecordingWriter


@pytest.fixture(scope="module")
def recording(tmp_path_factory, ball):
    """The path of a recording of six clouds by RecordingWriter, flushed after each."""
    cloud, sensor = ball
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    with RecordingWriter(path, sensor) as writer:
        for k in range(6):
            writer.log_cloud(10**18 + k * 10**8, k, cloud.xyz, cloud.intensity)
            writer.log_scalars(10**18 + k * 10**8, {"latency_ms": 30.0 + k, "points": len(cloud)}, k)
            writer.flush()
    return path


def test_it_prints_the_figures_and_writes_the_report_beside_the_recording(srt3d, recording):
    code, out, err = srt3d("review", recording, "--pictures", "own")
    assert code == 0 and err == ""
    assert "6, 10 Hz" in out and "median 32.5 ms" in out and out.endswith(f"{recording.with_suffix('.html')}\n")
    assert "A typical cloud" in recording.with_suffix(".html").read_text()


def test_json_is_one_line(srt3d, recording):
    code, out, _ = srt3d("review", recording, "--json", "--no-report")
    facts = json.loads(out)
    assert code == 0 and out.count("\n") == 1 and facts["report"] is None and facts["notes"] == []
    assert facts["frames"] == 6 and facts["latency_ms"]["total"]["max"] == 35 and facts["sensor"]["rows"] == 40


def test_a_recording_that_was_cut_off_is_repaired_into_a_copy_and_said_so(srt3d, recording, tmp_path):
    cut, data = tmp_path / "cut.rrd", recording.read_bytes()
    cut.write_bytes(data[:len(data) // 2])
    before = cut.read_bytes()
    code, out, err = srt3d("review", cut, "--json", "--no-report")
    facts = json.loads(out)
    assert code == 0 and cut.read_bytes() == before
    assert err.startswith(f"srt3d: {cut} was not finished: repaired into {tmp_path / 'cut_repaired.rrd'}, ")
    assert err.count("\n") == 1
    assert 2 <= facts["frames"] < 6 and facts["notes"] == [err.strip().removeprefix("srt3d: ")]


@pytest.mark.parametrize("content, expected", [
    (b"", "not empty"), (b"# not a recording\n" * 9, "as the recorder writes it"),
    (b"RRF2" + bytes([9, 9, 9, 0, 1, 2, 0, 0]), "it is of 9.9.9: pip install -U rerun-sdk")])
def test_empty_foreign_and_newer_files_are_one_line_each(refusal, tmp_path, content, expected):
    path = tmp_path / "a.rrd"
    path.write_bytes(content)
    said = refusal("review", path)
    assert said.startswith("recording is ") and expected in said


def test_a_frame_becomes_a_cloud_file(srt3d, recording, ball, tmp_path):
    code, out, _ = srt3d("review", recording, "--frame", -1, "-o", tmp_path / "a.npz", "--json")
    assert code == 0 and json.loads(out)["frame"] == 5
    with np.load(tmp_path / "a.npz") as file:
        assert len(file["row"]) == len(ball[0]) and set(np.unique(file["row"])) == set(range(40))


def test_compare_and_bag(srt3d, refusal, recording, tmp_path):
    code, out, _ = srt3d("review", recording, "--compare", recording)
    assert code == 0 and "6 of 6" in out and "by stamp" in out
    code, out, _ = srt3d("review", recording, "--to-bag", tmp_path / "bag")
    assert code == 0 and out == f"6 clouds on /points\n{tmp_path / 'bag'}\n"
    assert refusal("review", recording, "--to-bag", tmp_path / "bag").startswith("bag is ")


@pytest.mark.parametrize("arguments, expected", [
    (["--frame", "0"], "-o is missing: expected a file for the cloud"),
    (["--frame", "0", "-o", "a.xyz"], "ends in .npz, .ply, .pcd, .rrd, .png"),
    (["--frame", "9", "-o", "a.ply"], "a frame of the recording, 0 … 5"),
    (["-o", "a.pdf"], "ends in .html"), (["--no-report", "-o", "a.html"], "a report or a cloud to be asked for"),
    (["--turntable", "a.avi"], "ends in .gif, .mp4"), (["--compare", "no.rrd"], "an .rrd file that exists")])
def test_mistakes_are_one_line(refusal, recording, tmp_path, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    assert expected in refusal("review", recording, *arguments) and list(tmp_path.iterdir()) == []


def test_it_needs_no_ros(recording):
    code = ("import sys\nsys.modules['rclpy'] = sys.modules['torch'] = None\nfrom srt3d_ros.cli.main import main\n"
            f"sys.exit(main(['review', {str(recording)!r}, '--no-report']))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_chunk_at_which_rerun_would_end_the_process_is_one_line(repository):
    """The file was found by fuzzing: one byte of a chunk is another."""
    damaged = repository / "tests" / "recording" / "damaged.rrd"
    done = subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "review", str(damaged), "--no-report"],
                          capture_output=True, text=True)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "damaged.rrd: expected an .rrd file whose chunks can be read: " in line and line.endswith("SIGABRT")
