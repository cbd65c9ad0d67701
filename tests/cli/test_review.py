"""`srt3d review`: what it prints and writes."""

import json

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


def test_it_prints_the_figures_or_one_line_of_json_and_writes_the_report_beside_the_recording(srt3d, recording):
    code, out, err = srt3d("review", recording)
    assert code == 0 and err == ""
    assert "6, 10 Hz" in out and "median 32.5 ms" in out and out.endswith(f"{recording.with_suffix('.html')}\n")
    assert ": typical" in recording.with_suffix(".html").read_text()
    code, out, _ = srt3d("review", recording, "--json")
    facts = json.loads(out)
    assert code == 0 and out.count("\n") == 1 and facts["report"] is None
    assert facts["frames"] == 6 and facts["latency_ms"]["total"]["max"] == 35 and facts["sensor"]["rows"] == 40


def test_a_mistake_is_one_line(refusal, recording, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "ends in .html" in refusal("review", recording, "-o", "a.pdf") and list(tmp_path.iterdir()) == []
