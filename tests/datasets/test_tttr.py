"""Photons of older TCSPC formats, and what is said of those that are not read."""

import struct

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.datasets import CONVERTERS
from srt3d_ros.datasets.readers.tttr import NO_SCAN
from srt3d_ros.errors import InvalidInput

ADC, ROUTES = np.array([4095, 4000, 3995, 100]), np.array([0, 3, 0, 0])
KNOWN = {"irf": [1, 2, 1], "fov_deg": 10, "toa_offset_bins": 0.5}


@pytest.fixture
def phconvert():
    return pytest.importorskip("phconvert", reason="the extra tttr is not installed")


def spc(path, card=None):
    """An .spc file of an SPC-130 with a photon for each ADC, a marker and a photon that is invalid; .set beside it."""
    records = [135, *(ADC << 16 | ROUTES << 12 | np.arange(4)), 1 << 31 | 5 << 16, 1 << 28 | 1 << 12]
    path.write_bytes(np.array(records, "<u4").tobytes())
    if card is not None:
        head = struct.pack("<h", card << 4) + bytes(64)
        setup = b"SYS_PARA_BEGIN:\n#SP [SP_TAC_R,F,8.192e-08]\n#SP [SP_TAC_G,I,2]\nSYS_PARA_END:\n"
        path.with_suffix(".set").write_bytes(head + b"\n*IDENTIFICATION\nID : x\n*END\n*SETUP\n" + setup + b"*END\n")
    return path


def test_times_of_spc_are_turned_round_and_its_setup_gives_the_bin_width(tmp_path, phconvert):
    photons = read(spc(tmp_path / "a.spc", 0x20), **KNOWN)
    assert photons.frame.toa.tolist() == (4095 - ADC).tolist() and photons.notes == (NO_SCAN,)
    assert (photons.sensor.pixels, photons.sensor.num_bins) == (1, 4096)
    assert photons.sensor.bin_width_s == pytest.approx(1e-11)
    assert read(tmp_path / "a.spc", channel=3, **KNOWN).frame.toa.tolist() == [95]
    detectors = read(tmp_path / "a.spc", columns="detectors,nanotimes", num_bins=4096, shape=(2, 2), **KNOWN)
    assert detectors.frame.pixel.tolist() == [0, 3, 0, 0]


def test_spc_without_its_setup_says_what_was_assumed(tmp_path, phconvert):
    photons = read(spc(tmp_path / "a.spc"), **KNOWN)
    assert photons.frame.toa.tolist() == (4095 - ADC).tolist()
    assert photons.notes[0] == "no a.set beside it, which names the card: taken to be an SPC-1XX"
    assert "bin width taken as" in photons.notes[2]


def picoquant(path, records, rate_hz=20_000_000):
    """A .pt3 or .ht3 file of these records, in bins of 32 ps."""
    pt3 = path.suffix == ".pt3"
    head = struct.pack("<16s6s18s12s18s258s", b"", b"2.0" if pt3 else b"1.0", b"", b"", b"01/02/20 10:00:00", b"")
    if pt3:
        rest = bytes(72 + 64 + 36 + 36) + struct.pack("<16s8s6if2i", b"", b"", *[1] * 6, 0.032, 0, 0) + bytes(96)
        rest += struct.pack("<9i", 0, 0, 0, rate_hz, 0, 0, 0, len(records), 0)
    else:
        rest = bytes(24) + struct.pack("<d", 32.0) + bytes(40 + 64 + 36 + 36 + 32 + 80 + 48)
        rest += struct.pack("<4iQ", rate_hz, 0, 0, 0, len(records))
    path.write_bytes(head + rest + np.array(records, "<u4").tobytes())
    return path


@pytest.mark.parametrize(("suffix", "channel_bit", "toa_bit", "others"), [
    (".pt3", 28, 16, (0xF0000000, 0xF0010003)), (".ht3", 25, 10, (0xFE000001, 0x82000003))])
def test_photons_of_pt3_and_ht3_have_the_laser_s_period(tmp_path, phconvert, suffix, channel_bit, toa_bit, others):
    records = [1 << channel_bit | 7 << toa_bit | 1, others[0], 2 << channel_bit | 9 << toa_bit | 4, others[1]]
    path = picoquant(tmp_path / f"a{suffix}", records)
    photons = read(path, **KNOWN)
    assert photons.frame.toa.tolist() == [7, 9] and photons.notes == ()
    assert photons.sensor.num_bins == 1563 and photons.sensor.bin_width_s == pytest.approx(32e-12)
    assert read(path, channel=2, **KNOWN).frame.toa.tolist() == [9]
    path.write_bytes(path.read_bytes().replace(b"2.0" if suffix == ".pt3" else b"1.0", b"9.9", 1))
    with pytest.raises(InvalidInput, match=rf"^a{suffix} is unreadable \(OSError: Format .* tttrlib, converts others"):
        read(path, **KNOWN)


@pytest.mark.parametrize("suffix", CONVERTERS)
def test_one_line_names_a_converter_for_the_rest(tmp_path, suffix):
    (tmp_path / f"a{suffix}").write_bytes(b"PicoHarp")
    with pytest.raises(InvalidInput, match=rf"^a{suffix}: \w"):
        read(tmp_path / f"a{suffix}")
