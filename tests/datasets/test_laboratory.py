"""Laboratory files give the photons that were written into them; each is skipped where its library is missing."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.errors import InvalidInput
from tests.datasets import laboratory_files as files
from tests.datasets.laboratory_files import counts_of, t3

CUBE = files.pulse_cube()
IRF = [0.1, 0.25, 0.3, 0.25, 0.1]
LINE, STOP, FRAME = (1 << 31 | bit << 25 for bit in (1, 2, 4))
SCAN = {"ImgHdr_PixX": 2, "ImgHdr_PixY": 2, "ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2, "ImgHdr_Frame": 3,
        "ImgHdr_TimePerPixel": 0.12e-3}         # ms: ten laser periods


@pytest.mark.parametrize("record_type", [0x00010303, 0x00010307])
def test_frames_written_as_ptu_give_their_photons(tmp_path, record_type):
    ptufile, path = pytest.importorskip("ptufile"), tmp_path / "scan.ptu"
    counts = np.stack([CUBE, CUBE[::-1], CUBE[:, ::-1]])
    # Frames, rows, columns, channels, bins: all five, as releases differ in what fewer dimensions are.
    ptufile.imwrite(path, counts[:, :, :, None], 120 * 1e-10, 1e-10, record_type=record_type)
    photons = read(path, irf=IRF)
    assert (photons.sensor.num_bins, photons.sensor.bin_width_s) == (120, pytest.approx(1e-10))
    assert np.array_equal(counts_of(photons), counts.sum(axis=0))


def test_channels_and_incomplete_frames(tmp_path):
    pytest.importorskip("ptufile")
    body = [FRAME | 30, LINE | 40, t3(45, 7, 1), t3(51, 8, 1), t3(52, 9), STOP | 60,
            LINE | 70, t3(79, 10, 1), STOP | 90]
    path = files.ptu(tmp_path / "a.ptu", body, files.T3, SCAN)
    photons = read(path, irf=[1])
    assert photons.frame.pixel.tolist() == [0, 1, 2] and photons.frame.toa.tolist() == [7, 8, 10]
    assert "channel 1, which has the most, of 0, 1" in photons.notes[0]
    assert read(path, irf=[1], channel=0).frame.toa.tolist() == [9]
    early = files.ptu(tmp_path / "b.ptu", [LINE, t3(3, 5), STOP | 20, *body], files.T3, SCAN | {"ImgHdr_PixY": 4})
    assert read(early, irf=[1], channel=1).frame.toa.tolist() == [7, 8, 10]
    with pytest.raises(InvalidInput, match="channel is 5: expected one of 0, 1"):
        read(path, irf=[1], channel=5)


@pytest.mark.parametrize(("record_type", "sync", "bits"), [(files.T2, 1 << 31, 25), (files.PICOHARP_T2, 0, 28)])
def test_times_of_t2_count_from_the_laser_s_pulses(tmp_path, monkeypatch, record_type, sync, bits):
    pytest.importorskip("ptufile")
    monkeypatch.setattr("srt3d_ros.datasets.readers.ptu_t2.RECORDS", 10)
    overflow = 0xF0000000 if record_type == files.PICOHARP_T2 else 1 << 31 | 63 << 25 | 1
    body = [1 << bits | 3, sync | 1000, 1 << bits | 1250, sync | 2000, 2 << bits | 2300, 2 << bits | 2900, sync | 3000,
            overflow, 2 << bits | 1, sync | 500, 2 << bits | 1501]
    path = files.ptu(tmp_path / "t2.ptu", body, record_type, {"Measurement_SubMode": 0})
    photons = read(path, irf=[1], bin_width_s=1e-10)
    assert (photons.sensor.pixels, photons.sensor.num_bins) == (1, 10)
    wrap = {files.T2: 33_554_432, files.PICOHARP_T2: 210_698_240}[record_type]
    assert sorted(photons.frame.toa) == sorted([3, 9, round((wrap + 1 - 3000) % 1000 / 100), 0])
    assert not any("truncates" in note for note in photons.notes)
    assert photons.notes[0].startswith("photons of channel 2, which has the most, of 1, 2")
    assert "pulses on the sync channel, 1 ns apart" in photons.notes[1]
    assert read(path, irf=[1], channel=1).frame.toa.tolist() == [250]


def test_t2_without_the_laser_s_pulses_is_refused_in_one_line(tmp_path):
    pytest.importorskip("ptufile")
    path = files.ptu(tmp_path / "t2.ptu", [1 << 25 | 5], files.T2, SCAN)
    with pytest.raises(InvalidInput, match="t2.ptu sync channel is 0 events: expected the laser's pulses"):
        read(path, irf=[1])


def test_a_file_without_a_scan_is_one_pixel_and_a_cut_one_is_said_to_be(tmp_path):
    pytest.importorskip("ptufile")
    point = {"TTResult_NumberOfRecords": 5, "Measurement_SubMode": 0}
    path = files.ptu(tmp_path / "point.ptu", [t3(1, 5), t3(2, 6)], files.T3, point)
    photons = read(path, irf=[1])
    assert photons.sensor.pixels == 1 and photons.frame.toa.tolist() == [5, 6]
    assert "one pixel" in photons.notes[0] and photons.notes[1] == "cut off: 2 of 5 records are there"


def test_the_fullest_data_set_of_an_sdt_file_is_read_unless_another_is_chosen(tmp_path):
    pytest.importorskip("sdtfile")
    path = files.sdt(tmp_path / "a.sdt", [CUBE, CUBE * 2], 120e-10)
    photons = read(path, irf=IRF)
    assert np.array_equal(counts_of(photons), CUBE * 2) and photons.sensor.bin_width_s == pytest.approx(1e-10)
    assert photons.notes[0] == "photons of data set 1, which has the most, of 0, 1 (--channel)"
    assert np.array_equal(counts_of(read(path, irf=IRF, channel=0)), CUBE)
    with pytest.raises(InvalidInput, match="^a.sdt channel is 2: expected one of 0, 1"):
        read(path, channel=2)


@pytest.mark.parametrize(("laser_hz", "num_bins"), [(0, 120), (80e6, 125), (1e6, 120), (1e9, 120)])
def test_the_period_of_an_sdt_file_is_the_laser_s_where_the_tac_records_nearly_all_of_it(tmp_path, laser_hz, num_bins):
    pytest.importorskip("sdtfile")
    photons = read(files.sdt(tmp_path / "a.sdt", [CUBE], 120e-10, laser_hz), irf=IRF)
    assert photons.sensor.num_bins == num_bins and photons.photons == CUBE.sum()


@pytest.mark.parametrize(("laser_hz", "num_bins", "said"), [
    (80_000_000, 125, ""), (0, 33, "T taken to be the 33 bins that have photons: the file has no laser period"),
    (1_000_000_000, 33, "have photons: the laser's rate in the file means 10")])
def test_a_phu_file_gives_its_brightest_curve(tmp_path, laser_hz, num_bins, said):
    pytest.importorskip("ptufile")
    curves = [np.roll(np.pad(np.array([9, 30, 8]), (0, 117)), at) for at in (40, 30, 20, 41)]
    curves[1] *= 2
    path = files.phu(tmp_path / "a.phu", curves, 1e-10, laser_hz)
    photons = read(path, irf=IRF)
    assert photons.sensor.num_bins == num_bins and said in " ".join(photons.notes)
    assert np.array_equal(np.trim_zeros(counts_of(photons).ravel(), "b"), np.trim_zeros(curves[1], "b"))
    assert "photons of data set 1" in photons.notes[0]
    assert read(path, irf=IRF, channel=3).photons == 47
    (tmp_path / "a.phu").write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InvalidInput, match="^a.phu: The file is cut off"):
        read(path)
