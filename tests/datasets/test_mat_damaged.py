"""Damaged .mat files, read as users have them read: in a child process, whose end is one line here."""

import struct
import sys

import numpy as np
import pytest

from srt3d_ros.datasets import open_photons
from srt3d_ros.errors import InvalidInput
from tests.datasets.test_mat import IRF, cells, write


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    path = write(tmp_path, Ts=cells([[[12, 15], []]]))
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(InvalidInput, match="^some name.mat is unreadable"):
        open_photons(path, irf=IRF)


def test_a_damaged_matlab_7_3_file_is_refused_by_its_reader(tmp_path):
    pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + bytes(384) + b"\x89HDF")
    with pytest.raises(InvalidInput, match=r"^a\.mat is unreadable .*: expected a whole HDF5 file"):
        open_photons(path)


def test_a_file_that_unpacks_to_more_than_its_reader_may_take_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("srt3d_ros.datasets.mat.MAX_MEMORY_BYTES", 2**25)
    path = write(tmp_path, Y=np.zeros((2**12, 2**14), np.uint8))
    with pytest.raises(InvalidInput, match=r"^some name.mat is unreadable \(its reader takes more than 0.0312 G"):
        open_photons(path, irf=IRF)


def of_cells(dimensions: tuple[int, int], content: bytes = b"", kind: int = 1) -> bytes:
    """A variable Ts, as it stands in a file."""
    parts = [(6, struct.pack("<II", kind, 0)), (5, struct.pack("<ii", *dimensions)), (1, b"Ts")]
    body = b"".join(struct.pack("<II", code, len(part)) + part.ljust(-(-len(part) // 8) * 8, b"\0")
                    for code, part in parts) + content
    return struct.pack("<II", 14, len(body)) + body


def written(path, *variables: bytes):
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(variables))
    return path


def test_a_file_at_which_scipy_ends_the_process_is_one_line(tmp_path):
    cell = of_cells((1, 1), struct.pack("<HH4s", 99, 4, b"\x0c"), kind=11)      # MATLAB has no such type code
    with pytest.raises(InvalidInput) as caught:
        open_photons(written(tmp_path / "a.mat", of_cells((1, 1), cell)), irf=IRF)
    assert str(caught.value).startswith("a.mat is unreadable (its reader ended with SIG")


def test_a_missing_scipy_is_said_as_such(tmp_path, monkeypatch):
    path = write(tmp_path, Ts=cells([[[12, 15], []]]))
    (tmp_path / "scipy.py").write_text("raise ModuleNotFoundError('No module named scipy', name='scipy')")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with pytest.raises(ModuleNotFoundError) as caught:
        open_photons(path)
    assert caught.value.name == "scipy"


def test_structures_beside_the_photons_are_not_read(tmp_path):
    good = of_cells((1, 1), of_cells((1, 1), struct.pack("<II8s", 4, 2, b"\x0c"), kind=11))
    path = written(tmp_path / "a.mat", good, of_cells((2**31 - 1, 2**31 - 1), kind=17))     # an opaque object
    assert open_photons(path, irf=IRF, num_bins=20).frame.toa.tolist() == [12]
    with pytest.raises(InvalidInput, match="a.mat variables is others, some of them objects"):
        open_photons(written(path, of_cells((1, 1), kind=17)))
