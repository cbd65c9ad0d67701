"""VL53L8CH: both programs' logs give the same histograms; nothing here has seen a device."""

import numpy as np
import pytest

from benchmarks import devices as benchmark
from srt3d_ros.devices import vl53l8ch
from srt3d_ros.errors import InvalidInput
from tests.devices import made

BIN_M = 37.5348e-3
RANGE_M = np.linspace(0.4, 1.2, 16)


@pytest.fixture
def frames() -> list[np.ndarray]:
    """Two frames of 16 zones, with noise around 0 as ambient light was subtracted."""
    rng = np.random.default_rng(0)
    return [rng.normal(0, 5, (16, 48)) + 5000 * made.pulse(48, shift + RANGE_M / BIN_M - 0.5, 2.5) for shift in (0, 1)]


def as_table(frames) -> str:
    names = [f"cnh__hist_bin_{k}_a{zone}" for k in range(48) for zone in range(16)]
    lines = [",".join(["time", *names])] + [",".join(["0", *map(repr, map(float, one.T.ravel()))]) for one in frames]
    return "\n".join(lines)


def as_lines(frames) -> str:
    return "\n".join(f"Aggregate {zone}, Ambient: 3.5, Bins: " + "".join(f"{value:.6f}, " for value in values)
                     for one in frames for zone, values in enumerate(one))


@pytest.mark.parametrize("write, suffix", [(as_table, ".csv"), (as_lines, ".txt")])
def test_logs(tmp_path, frames, write, suffix):
    path = tmp_path / f"log{suffix}"
    path.write_text(write(frames))
    assert vl53l8ch.recognises(write(frames)[:2000])
    readings = list(vl53l8ch.read(path))
    assert len(readings) == 2
    for one, expected in zip(readings, frames):
        assert one.frame.counts.reshape(16, 48) == pytest.approx(expected, abs=1e-3)
    found = benchmark.found_mm(readings[0], tuple(range(1, 8)))
    assert np.median(np.abs(found.ravel() - RANGE_M * 1e3)) < 10


def test_frames_with_lost_lines_are_left_out(tmp_path, frames):
    lines = as_lines([*frames, frames[0]]).splitlines()
    del lines[20]
    path = tmp_path / "log.txt"
    path.write_text("\n".join(lines))
    assert [one.frame.photons for one in vl53l8ch.read(path)] == [round(float(frames[0].astype(np.float32).sum()))] * 2


@pytest.mark.parametrize("content", ["cnh__hist_bin_0_a0,cnh__hist_bin_1_a0,cnh__hist_bin_1_a1\n1,2,3",
                                     "cnh__hist_bin_0_a0,cnh__hist_bin_1_a0\n1,x",
                                     "cnh__hist_bin_0_a0,cnh__hist_bin_1_a0\n1",
                                     "Aggregate 0, Ambient: 1, Bins: 1, 2, x,"])
def test_broken_logs_are_refused(tmp_path, content):
    path = tmp_path / "log.csv"
    path.write_text(content)
    with pytest.raises(InvalidInput, match="log.csv"):
        list(vl53l8ch.read(path))
