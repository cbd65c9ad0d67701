"""Logs of histograms are bounded, and opened frame by frame like photon files."""

import gzip

import numpy as np
import pytest

from srt3d_ros import datasets
from srt3d_ros.datasets.readers import tmf8829
from srt3d_ros.errors import InvalidInput
from tests.datasets import made_logs

CUT_OFF = gzip.compress(b"[" * 1000, mtime=0)[:30]
SLANTED = np.linspace(1.0, 2.0, 16)


@pytest.fixture
def log(tmp_path):
    """A log of two frames."""
    return made_logs.tmf8829_log(tmp_path / "log.json", [made_logs.zones_16(SLANTED), made_logs.zones_16(SLANTED + 1)])


def test_a_packed_log_is_read_as_it_was(tmp_path, log):
    packed = tmp_path / "c.json.gz"
    packed.write_bytes(gzip.compress(log.read_bytes()))
    assert (datasets.read(packed).frame.counts == datasets.read(log).frame.counts).all()


def test_a_log_opens_as_a_photon_file_does(tmp_path, log):
    second = datasets.read(log, frame=1, fov_deg=20, range_offset_m=0.25)
    assert (second.name, second.sensor.range_offset_m) == ("log", 0.25)
    assert (second.frame.counts == made_logs.zones_16(SLANTED + 1)[..., :54]).all() and second.notes
    for frame in (2, -1):
        with pytest.raises(InvalidInput, match="frame"):
            datasets.read(log, frame=frame)


@pytest.mark.parametrize("content", [
    b"\xff\xfe\0\0", b"[", b"{}", b"[]", b"[3]", b"[" * 10**5, b'{"rows": 3}', b'{"Result_Set": [{}]}',
    b'{"Result_Set": []}', b'{"Result_Set": [{"mp_histo": [[{"bin": [1]}]], "ref_histo": [{"bin": [1]}]}]}'],
    ids=range(10))
def test_broken_logs_are_refused(tmp_path, content):
    for name, raw in (("log.json", content), ("log.json.gz", gzip.compress(content)), ("cut.gz", CUT_OFF)):
        (tmp_path / name).write_bytes(raw)
        with pytest.raises(InvalidInput, match=f"^{name}"):
            datasets.read(tmp_path / name)


def test_logs_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(tmf8829, "MAX_LOG_BYTES", 100)
    path = tmp_path / "log.json.gz"
    path.write_bytes(gzip.compress(bytes(10**6)))
    with pytest.raises(InvalidInput, match="more than 100 bytes"):
        datasets.read(path)
