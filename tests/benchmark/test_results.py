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
    results.append("table1", {"ms": {"min": 2}})
    assert [line["ms"]["min"] for line in written(path)] == [1, 2]
    assert [entry.name for entry in path.parent.iterdir()] == ["a.jsonl"]


def test_a_part_measured_anew_replaces_its_lines_and_no_others(path):
    first = Results(path)
    for part, value in (("table1", 1), ("table1", 2), ("ros", 3)):
        first.append(part, {"value": value})
    second = Results(path)
    assert len(written(path)) == 3                      # nothing is lost before there is something better
    second.append("table1", {"value": 4})
    assert sorted(line["value"] for line in written(path)) == [3, 4]


@pytest.mark.parametrize("text", ["no JSON", "[1, 2]\n", '{"other": 1}\n', b"\xff\xfe",
                                  '{"part": "table1", "method": "srt3d-paper"}\n'])
def test_another_file_is_not_overwritten(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    before = path.read_bytes()
    with pytest.raises(InvalidInput, match="a.jsonl"):
        Results(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("cpu, slug", [
    ("AMD EPYC", "amd-epyc-2-cores"), ("Intel(R) Xeon(R) Processor @ 2.30GHz", "intel-xeon-2-cores"),
    ("AMD Ryzen 7 5800X 8-Core Processor", "amd-ryzen-7-5800x-2-cores"), ("aarch64", "aarch64-2-cores")])
def test_the_file_is_named_after_the_processor(monkeypatch, cpu, slug):
    monkeypatch.setattr(module, "cpu_name", lambda: cpu)
    monkeypatch.setattr(module, "cores", lambda: 2)
    assert machine_slug("cpu") == slug


def test_or_after_the_gpu(monkeypatch):
    monkeypatch.setattr(module, "gpu_name", lambda: "NVIDIA H100 80GB HBM3")
    assert machine_slug("cuda") == "nvidia-h100-80gb-hbm3"
