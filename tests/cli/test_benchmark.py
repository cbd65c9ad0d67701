"""`srt3d benchmark` prints one screen, whose figures are those of the frames; a mistake is one line."""

import re

import numpy as np
import pytest
import torch

from srt3d_ros import benchmark
from srt3d_ros.cli import main

MB = 10**6


def test_one_screen_has_every_size_and_every_form(monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "SIDES", (12, 16))
    monkeypatch.setattr(benchmark, "CYCLES", 40)
    assert main.main(["benchmark", "--device", "cpu"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if re.match(r"\| [^p-]", line)]
    assert [(row[0], row[1]) for row in rows[:4]] == [("12²", "5"), ("12²", "10"), ("16²", "5"), ("16²", "10")]
    assert [row[0] for row in rows[4:]] == ["sorted by pixel", "in any order", "gates", "histograms"]
    assert all(1e3 / float(row[2]) == pytest.approx(float(row[3]), rel=0.02) for row in rows[:4])
    assert all(float(row[3]) * float(row[2]) / 1e3 == pytest.approx(100 * 12 * 12, rel=0.1) for row in rows[4:6])
    assert len(lines) < 24 and "load" in lines[0]


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_device_that_is_not_there_is_one_line(refusal):
    assert "cuda" in refusal("benchmark", "--device", "cuda")


def test_every_form_has_the_photons_that_are_said():
    frames = benchmark.sketched_frames()
    (_, events), (_, mixed), (_, gates), (_, histograms) = frames.values()
    assert events.is_sorted and not mixed.is_sorted
    assert sorted(zip(mixed.pixel[:9], mixed.toa[:9])) != sorted(zip(events.pixel[:9], events.toa[:9]))
    assert events.photons == mixed.photons == pytest.approx(100 * 141 * 141, rel=0.01)
    assert gates.words.shape == (benchmark.CYCLES, 32, 32)
    assert histograms.counts.sum() == pytest.approx(100 * 32 * 32, rel=0.02)


def test_memory_is_the_peak_of_the_call_alone(tmp_path, monkeypatch):
    np.ones(50 * MB)
    assert 79 * MB < benchmark.peak_growth(lambda: len(np.ones(10 * MB))) < 120 * MB
    monkeypatch.setattr(benchmark, "PROCESS", tmp_path / "absent")
    assert benchmark.peak_growth(lambda: None) is None
