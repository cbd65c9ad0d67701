"""The result file: each line at once, a part's lines replaced as a whole, the file named after the machine."""

import json

import pytest

from srt3d_ros.benchmark import results as module
from srt3d_ros.benchmark.results import Results, machine_slug
from srt3d_ros.errors import InvalidInput


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.jsonl"


def written(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_a_line_is_on_the_disk_with_the_machine_it_is_of(path):
    results = Results(path)
    results.append("table1", {"ms": {"min": 1}, "device": "cpu"})
    (line,) = written(path)
    assert line == results.lines["table1"][0] and line["part"] == "table1" and line["ms"] == {"min": 1}
    assert {"date", "machine", "cpus", "load_1min", "python", "srt3d_ros", "numpy", "torch", "numba"} <= set(line)
    assert [entry.name for entry in path.parent.iterdir()] == ["a.jsonl"]


def test_a_part_measured_anew_replaces_its_lines_and_no_others(path):
    first = Results(path)
    for part, value in (("table1", 1), ("table1", 2), ("ros", 3)):
        first.append(part, {"value": value})
    second = Results(path)
    assert len(written(path)) == 3                      # nothing is lost before there is something better
    second.append("table1", {"value": 4})
    assert sorted(line["value"] for line in written(path)) == [3, 4]


@pytest.mark.parametrize("content", [b"no JSON", b"[1, 2]\n", b'{"other": 1}\n', b"\xff\xfe"])
def test_another_file_is_not_overwritten(path, content):
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match="a.jsonl"):
        Results(path)
    assert path.read_bytes() == content


@pytest.mark.parametrize("facts, slug", [
    ({"machine": "Intel(R) Xeon(R) Processor @ 2.30GHz"}, "intel-xeon-2-cores"),
    ({"machine": "AMD Ryzen 7 5800X 8-Core Processor"}, "amd-ryzen-7-5800x-2-cores"),
    ({"machine": "AMD EPYC", "gpu": "NVIDIA H100 80GB HBM3"}, "nvidia-h100-80gb-hbm3")])
def test_the_file_is_named_after_the_processor_or_the_gpu(monkeypatch, facts, slug):
    monkeypatch.setattr(module, "machine", lambda device: {"cpus": 2} | facts)
    assert machine_slug("cuda") == slug
