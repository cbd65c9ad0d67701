"""AS-DT1: raw frames in the layout of Sony's driver; nothing here has seen a device."""

import numpy as np
import pytest

from benchmarks import devices as benchmark
from srt3d_ros.devices import as_dt1
from srt3d_ros.errors import InvalidInput
from tests.devices import made

BIN_M, ZERO_M = 0.25, 0.4
FULL = (0, 12, 4, 16, 8, 20, 1, 13, 5, 17, 9, 21)       # bank_to_ring_full of the driver, and _half
HALF = (0, 6, 2, 8, 4, 10)


def recording(path, banks: int, frames: int = 2):
    """A slanted wall; ranges [rows, 24]."""
    rows = 2 * min(banks, 12)
    row, col = np.mgrid[:rows, :24]
    distance = 3 + 0.5 * col + 0.2 * row
    counts = np.round(20 + 4000 * made.pulse(144, (distance - ZERO_M) / BIN_M, 1.5)).astype(int)
    across, down = (col - 11.5) / 45, (row - (rows - 1) / 2) / 50
    z = distance / np.sqrt(1 + across**2 + down**2)
    data = np.zeros((frames, banks), as_dt1.BANK)
    for bank in range(banks):
        ring, second = (HALF[bank], 1) if banks == 6 else (FULL[bank % 12], 2)
        data["bank"][:, bank], data["cpu_ms"][:, bank] = bank, 40 * np.arange(frames)
        for dot in range(48):
            at = ring + second * (dot // 24), dot % 24
            data["dots"]["bins"][:, bank, dot] = counts[at]
            for axis, metres in {"radial": distance, "x": down * z, "y": -across * z, "z": z}.items():
                data["dots"]["first"][axis][:, bank, dot] = round(metres[at] * 4000) & 0x3FFFFF
    path.write_bytes(data.tobytes())
    return distance


def test_the_layout_has_the_drivers_sizes():
    assert (as_dt1.DOT.itemsize, as_dt1.BANK.itemsize) == (672, 33_600)


@pytest.mark.parametrize("banks", [6, 12, 24])
def test_frames(tmp_path, banks):
    path = tmp_path / "scan.asdt1"
    distance = recording(path, banks)
    readings = list(as_dt1.read(path))
    sensor = readings[0].sensor
    assert [one.frame.stamp_ns for one in readings] == [0, 40_000_000]
    assert sensor.bin_width_m == pytest.approx(BIN_M, rel=0.02)
    assert sensor.rays[0, 0, 0] < -0.2 and sensor.rays[0, 0, 1] < -0.1      # left and up, in the optical frame
    found = benchmark.found_mm(readings[1], tuple(range(1, 20))) / 1e3
    assert np.nanmedian(np.abs(found - distance)) < 0.1 and np.isnan(found).sum() == 0


def test_broken_recordings_are_refused(tmp_path):
    path = tmp_path / "scan.asdt1"
    for data, expected in ((b"", "0 bytes"), (bytes(100), "100 bytes"), (bytes(33_600), "banks"),
                           (bytes(33_600 * 6), "banks")):
        path.write_bytes(data)
        with pytest.raises(InvalidInput, match=expected):
            list(as_dt1.read(path))
    recording(path, 6)
    data = np.fromfile(path, as_dt1.BANK)
    data["dots"]["first"]["err"] = 1
    data.tofile(path)
    with pytest.raises(InvalidInput, match="dots with a peak"):
        list(as_dt1.read(path))
