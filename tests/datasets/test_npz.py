"""The npz photon file: what is written comes back, and what cannot be used is named in one line."""

import os
import struct
import zipfile

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import photon_file
from srt3d_ros.errors import InvalidInput
from srt3d_ros.files import array_files as files

IRF = np.array([0.25, 0.5, 0.25], np.float32)
SENSOR = SensorModel(2, 3, 50, 1e-10, IRF, toa_offset_bins=7.5, range_offset_m=-0.1)
EVENTS = PhotonEvents(np.array([5, 0, 0, 3], np.uint32), np.array([49, 0, 7, 8], np.uint16), stamp_ns=123)


def good() -> dict:
    return {"rows": 2, "cols": 3, "num_bins": 50, "bin_width_s": 1e-10, "irf": IRF,
            "pixel": EVENTS.pixel, "toa": EVENTS.toa}


def write(tmp_path, **changes):
    path = tmp_path / "photons.npz"
    np.savez(path, **{name: value for name, value in (good() | changes).items() if value is not None})
    return path


def test_the_better_reference_is_preferred_and_arrays_of_other_names_are_left_alone(tmp_path):
    one, two, three = (np.full((2, 3), value, np.float32) for value in (1, 2, 3))
    photons = read(write(tmp_path, ref_depth_bins=one, ref_depth_ml_bins=two, ref_depth_bins_2=three))
    assert photons.reference_depth_bins[:, 0, 0].tolist() == [2, 3]
    assert read(write(tmp_path)).reference_depth_bins is None
    path = write(tmp_path, anything=np.array([{"an": "object"}], dtype=object), source="a text", fov_deg=20.0)
    photons = read(path)
    assert photons.frame.photons == 4 and photons.sensor.projection == Pinhole.from_fov(2, 3, 20)


DEPTH = np.full((2, 3), 20.0)
@pytest.mark.parametrize(("field", "changes"), [
    ("rows", {"rows": None}), ("toa", {"toa": None}), ("rows", {"rows": 0}), ("rows dtype", {"rows": "two"}),
    ("rows shape", {"rows": [2, 2]}), ("frame_id dtype", {"frame_id": 0.5}), ("irf dtype", {"irf": IRF + 0j}),
    ("irf", {"irf": -IRF}), ("irf shape", {"irf": 100.0}),
    ("pixel", {"pixel": np.array([2**32, 0, 0, 0])}), ("toa", {"toa": np.array([65_536, 50, -1, 0])}),
    ("pixel and toa shapes", {"toa": EVENTS.toa[:3]}),
    ("ref_depth_bins shape", {"ref_depth_bins": DEPTH.T}), ("projection", {"projection": "fisheye"}),
    ("projection_values", {"projection": "pinhole"}), ("fov_deg", {"fov_deg": 200.0}),
    ("projection_values shape", {"projection": "pinhole", "projection_values": np.ones(3)}),
    ("distortion", {"projection": "angular_scan", "projection_values": np.ones(4), "distortion": np.ones(5)}),
    ("gate_words shape", {"gate_words": np.array([1])}),
    ("frame_id", {"frame_id": np.array([0x7FFFFFFF, 65], np.uint32).view("<U2")})])     # no character
@pytest.mark.filterwarnings("error")
def test_malformed_files_are_named_in_one_line(tmp_path, field, changes):
    with pytest.raises(InvalidInput) as caught:
        read(write(tmp_path, **changes))
    assert caught.value.field == f"photons.npz {field}"
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def header(shape: object, dtype: object = "<u2", body: bytes = b"") -> bytes:
    """An .npy file of this header, and some data."""
    text = repr({"descr": dtype, "fortran_order": False, "shape": shape})
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode("latin-1") + body


@pytest.mark.parametrize(("content", "expected"), [
    (header((2**40,), body=bytes(2**20)), "size is 2199023255552 bytes: expected at most"),
    (header((4,), body=b"12"), "size is 2 bytes: expected 8 bytes"), (header((-2, -2)), "shape is"),
    (header(("a",)), "is unreadable")])
def test_members_that_are_no_array_are_one_line(tmp_path, content, expected):
    path = write(tmp_path, toa=None)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("toa.npy", content)
    with pytest.raises(InvalidInput, match=f"^photons.npz toa {expected}") as caught:
        read(path)
    assert len(str(caught.value).splitlines()) == 1


def test_arrays_that_are_too_much_together_are_refused(tmp_path, monkeypatch):
    path = write(tmp_path, gain=np.ones((2, 3)), mask=np.ones((2, 3)))
    monkeypatch.setattr(files, "MAX_ARRAY_BYTES", 120)
    with pytest.raises(InvalidInput, match="^photons.npz size is .* bytes: expected at most 120;"):
        read(path)


def test_nothing_is_unpickled(tmp_path):
    harmful = type("Harmful", (), {"__reduce__": lambda self: (os.mkdir, (str(tmp_path / "harm"),))})
    with pytest.raises(InvalidInput, match="^photons.npz pixel dtype is"):
        read(write(tmp_path, pixel=np.array([harmful()] * 4)))
    assert not (tmp_path / "harm").exists()


@pytest.mark.parametrize(("name", "expected"), [
    ("photons.npz.zip", "expected a file that ends in .npz, .npy, .mat, .csv"), ("absent.mat", "no such file"),
    ("simulater", "simulater: no such file"), ("absent.mcap", "no such bag"),
    ("folder.npz", "no such file"), ("a" * 300 + ".npz", "^Cannot read "), ("a" * 300 + ".mcap", "^Cannot read ")])
def test_what_is_no_photon_file_is_named(tmp_path, name, expected):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "photons.npz.zip").touch()
    with pytest.raises(InvalidInput, match=expected):
        read(tmp_path / name)


@pytest.mark.parametrize(("field", "arguments"), [
    ("output", ("a.txt", SENSOR, EVENTS)), ("output", ("absent/a.npz", SENSOR, EVENTS)),
    ("toa", ("a.npz", SENSOR.replace(num_bins=49), EVENTS)), ("pixel", ("a.npz", SENSOR.replace(rows=1), EVENTS)),
    ("reference_depth_bins shape", ("a.npz", SENSOR, EVENTS, np.zeros((3, 2)))),
])
def test_what_cannot_be_saved_is_named(tmp_path, field, arguments):
    with pytest.raises(InvalidInput) as caught:
        photon_file.save(tmp_path / arguments[0], *arguments[1:])
    assert caught.value.field == field
