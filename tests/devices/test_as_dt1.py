"""AS-DT1: raw frames in the layout of Sony's driver; nothing here has seen a device."""

import numpy as np
import pytest

from benchmarks import devices as benchmark
from srt3d_ros.devices import as_dt1
from srt3d_ros.errors import InvalidInput
from tests.devices import made


@pytest.mark.parametrize("banks", [6, 12, 24])
def test_frames(tmp_path, banks):
    assert (as_dt1.DOT.itemsize, as_dt1.BANK.itemsize) == (672, 33_600)         # the driver's sizes
    path = tmp_path / "scan.asdt1"
    _, distance = made.as_dt1_log(path, banks)
    readings = list(as_dt1.read(path))
    sensor = readings[0].sensor
    assert [one.frame.stamp_ns for one in readings] == [0, 40_000_000]
    assert sensor.bin_width_m == pytest.approx(made.DT1_BIN_M, rel=0.02)
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
    made.as_dt1_log(path, 6)
    data = np.fromfile(path, as_dt1.BANK)
    data["dots"]["first"]["err"] = 1
    data.tofile(path)
    with pytest.raises(InvalidInput, match="dots with a peak"):
        list(as_dt1.read(path))
