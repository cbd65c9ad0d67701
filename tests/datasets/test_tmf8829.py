"""TMF8829: messages and logs become histograms in their places, and these ranges; what is broken is refused."""

import gzip
import json

import numpy as np
import pytest

from examples.tmf8829_messages import decode
from srt3d_ros import read
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.readers import tmf8829
from srt3d_ros.errors import InvalidInput
from tests.datasets import made_logs as made
from tests.datasets.made_logs import zones_mm

SLANTED = np.linspace(1.0, 2.0, 16)
CUT_OFF = gzip.compress(b"[" * 1000, mtime=0)[:30]


@pytest.mark.parametrize("mode", made.SIZES)
def test_every_zone_of_a_message_comes_to_its_place(mode):
    rows, cols, bins = made.SIZES[mode]
    zones = np.zeros((rows, cols, bins), int)
    zones[..., 20] = 70_000 + np.arange(rows * cols).reshape(rows, cols)       # more than 16 bits
    photons = decode(made.message(zones, mode), stamp_ns=5)
    sensor, frame = photons.sensor, photons.frame
    assert (sensor.rows, sensor.cols, frame.stamp_ns) == (rows, cols, 5)
    assert (frame.counts == zones[..., :frame.counts.shape[-1]]).all()
    assert frame.counts.shape[-1] == sensor.num_bins == {256: 218, 64: 54}[bins]
    assert sensor.bin_width_s == pytest.approx({256: 0.2e-9, 64: 0.8e-9}[bins])


def test_ranges_and_rays_of_a_message():
    truth = np.linspace(0.6, 3.5, 16)[:, None] + np.linspace(0, 0.3, 16)
    reading = decode(made.message(made.zones_16(truth)), 0)
    found, (x, y, z) = zones_mm(reading), reading.sensor.rays[0, 0] * 1018.0
    assert (x, y, z) == pytest.approx((-501.4, -376.0, 802.2), abs=0.1)     # of the vendor's log: distance 1018 mm
    assert np.nanmax(np.abs(found - truth * 1e3)) < 15 and not np.isnan(found).any()
    assert decode(made.message(made.zones_16(truth), parts=()), 0) is None      # without histograms


@pytest.mark.parametrize("broken", [
    pytest.param(lambda whole: whole[:50], id="header cut off"),
    pytest.param(lambda whole: b"\0" + whole[1:], id="another magic number"),
    pytest.param(lambda whole: whole[:84 + 3], id="frame's header cut off"),
    pytest.param(lambda whole: whole[:-20_000], id="frame cut off"),
    pytest.param(lambda _: made.message(made.zones_16(1.0), parts=(0,)), id="half of the zones"),
    pytest.param(lambda whole: whole.replace(b"\x22\x01", b"\x2f\x01"), id="unknown mode"),
    pytest.param(lambda whole: whole.replace(b"\x22\x01", b"\x22\x07"), id="unknown part"),
])
def test_broken_messages_are_refused(broken):
    with pytest.raises(InvalidInput, match="message"):
        decode(broken(made.message(made.zones_16(1.0), results=False)), 0)


# ---- Logs

@pytest.fixture
def log(tmp_path):
    """A log of two frames."""
    return made.tmf8829_log(tmp_path / "log.json", [made.zones_16(SLANTED), made.zones_16(SLANTED + 1)])


def test_a_log_opens_as_a_photon_file_does_packed_or_not(tmp_path, log):
    packed = tmp_path / "c.json.gz"
    packed.write_bytes(gzip.compress(log.read_bytes()))
    readings = [read(log), read(packed, frame=1, fov_deg=20, range_offset_m=0.25)]
    assert [np.nanmedian(zones_mm(one)) for one in readings] == pytest.approx([1500, 2750], abs=5)
    assert [one.frame.stamp_ns for one in readings] == [53_283_768_000, 53_316_768_000]
    assert (readings[0].name, readings[1].sensor.range_offset_m) == ("log", 0.25)
    assert (readings[1].frame.counts == made.zones_16(SLANTED + 1)[..., :54]).all() and readings[1].notes
    for frame in (2, -1):
        with pytest.raises(InvalidInput, match="frame"):
            read(log, frame=frame)


def test_a_log_with_the_loggers_fault_is_read_as_row_0(tmp_path):
    """Histogram [y][…] is that of zone y of row 0: seen in the vendor's log, whose results say so."""
    truth = np.linspace(1.0, 3.0, 16)
    faulty = made.zones_16(truth[:, None])
    photons = next(tmf8829.frames(made.tmf8829_log(tmp_path / "log.json", [faulty]), Options()))()
    sensor, notes = photons.sensor, photons.notes
    assert (sensor.rows, sensor.cols) == (1, 16) and any("row 0" in note for note in notes)
    assert zones_mm(photons)[0] == pytest.approx(truth * 1e3, abs=15)
    assert sensor.rays[0, 0, 1] < -0.3              # the top row still looks up


def of_zones(rows: int, references: int, **configuration) -> bytes:
    zones = [[{"bin": [1] * 64}] * 16] * rows
    return json.dumps({"configuration": configuration, "Result_Set": [
        {"mp_histo": zones, "ref_histo": [{"bin": [1] * 64}] * references}]}).encode()


@pytest.mark.parametrize("content", [
    of_zones(15, 8), of_zones(16, 7), of_zones(16, 8, bin_shift=3),
    b"\xff\xfe\0\0", b"[", b"{}", b"[]", b"[3]", b"[" * 10**5, b'{"rows": 3}', b'{"Result_Set": [{}]}',
    b'{"Result_Set": []}', b'{"Result_Set": [{"mp_histo": [[{"bin": [1]}]], "ref_histo": [{"bin": [1]}]}]}'],
    ids=range(13))
def test_broken_logs_are_refused(tmp_path, content):
    for name, raw in (("log.json", content), ("log.json.gz", gzip.compress(content)), ("cut.gz", CUT_OFF)):
        (tmp_path / name).write_bytes(raw)
        with pytest.raises(InvalidInput, match=f"^{name}"):
            read(tmp_path / name)


def test_the_vendors_log_agrees_with_its_own_results(shared_data):
    path = shared_data / "histograms" / "tmf8829_log.json.gz"
    if not path.is_file():
        pytest.skip(f"no {path}")
    with gzip.open(path) as stream:
        results = [frame["results"][0] for frame in json.load(stream)["Result_Set"]]      # of row 0, all that it has
    own, snr = (np.array([[zone["peaks"][0][key] for zone in row] for row in results], float)
                for key in ("distance", "snr"))
    found = np.concatenate([zones_mm(frame()) for frame in tmf8829.frames(path, Options())])
    off = (found - own)[snr >= 20]
    assert (off.size, np.isnan(off).sum()) == (375, 0) and np.median(np.abs(off)) <= 20
