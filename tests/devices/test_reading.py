"""Logs are bounded, recognised by what is in them, and opened like photon files; a stream's sensor is steady."""

import gzip
import json

import numpy as np
import pytest

from srt3d_ros import devices
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.devices import reading
from srt3d_ros.errors import InvalidInput
from tests.devices import made

SLANTED = np.linspace(1.0, 2.0, 16)


def test_logs_are_recognised(tmp_path):
    logs = {"tmf8829": made.tmf8829_log(tmp_path / "a.json", [made.zones_16(1.0)]),
            "tmf882x": made.tmf882x_log(tmp_path / "b.json", [9.0])}
    packed = tmp_path / "c.json.gz"
    packed.write_bytes(gzip.compress(logs["tmf8829"].read_bytes()))
    assert {name: devices.of_log(path) for name, path in logs.items()} == {name: devices.DEVICES[name] for name in logs}
    assert devices.of_log(packed) is devices.DEVICES["tmf8829"]
    other = tmp_path / "sensor.json"
    other.write_text('{"rows": 3}')
    assert devices.of_log(other) is None and devices.of_log(tmp_path / "absent.json") is None


def test_a_log_opens_as_a_photon_file_does(tmp_path):
    path = made.tmf8829_log(tmp_path / "log.json", [made.zones_16(SLANTED), made.zones_16(SLANTED + 1)])
    (tmp_path / "log.json.json").write_text(json.dumps({"range_offset_m": 0.25}))
    second = devices.open_stream(path, frame=1, fov_deg=20)
    assert (second.name, second.sensor.range_offset_m) == ("log", 0.25)
    assert (second.frame.counts == made.zones_16(SLANTED + 1)[..., :54]).all() and second.notes
    for frame in (2, -1):
        with pytest.raises(InvalidInput, match="frame"):
            devices.open_stream(path, frame=frame)
    with pytest.raises(InvalidInput, match="photon file"):
        devices.open_stream(tmp_path / "absent.npz")


CUT_OFF = gzip.compress(b"[" * 1000, mtime=0)[:30]


@pytest.mark.parametrize("content", [b"\xff\xfe\0\0", CUT_OFF, b"\x1f\x8b\x08nonsense"],
                         ids=["binary", "cut off", "no gzip"])
def test_damaged_logs_are_refused(tmp_path, content):
    path = tmp_path / "log.json.gz"
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match="log.json.gz"):
        reading.json_log(path)


def test_logs_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "MAX_LOG_BYTES", 100)
    path = tmp_path / "log.json.gz"
    path.write_bytes(gzip.compress(bytes(10**6)))
    with pytest.raises(InvalidInput, match="more than 100 bytes"):
        reading.text(path)


def test_a_steady_sensor_follows_what_is_new_only():
    def sensor(at: float, photons: float, **changes) -> SensorModel:
        irf = np.random.default_rng(round(1e4 * at)).poisson(photons * made.pulse(64, np.array(at)))
        return SensorModel(2, 2, 64, 1e-9, irf, 3, **changes)

    steady = reading.Steady()
    first = steady.sensor(sensor(3.2, 3e5))
    assert steady.sensor(sensor(3.2001, 3e5)) is first             # noise
    assert steady.sensor(sensor(3.205, 3e5)) is first
    moved = sensor(3.3, 3e5)
    assert steady.sensor(moved) is moved
    other = sensor(3.3, 3e5, frame_id="other")
    assert steady.sensor(other) is other
