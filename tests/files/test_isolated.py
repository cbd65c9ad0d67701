"""Damaged and hostile .mat files, read as users have them read: in a child process, whose end is one line here."""

import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from srt3d_ros import read
from srt3d_ros.errors import InvalidInput
from srt3d_ros.files import isolated
from tests.datasets.test_mat import IRF, cells, write


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content.ljust(-(-len(content) // 8) * 8, b"\0")


def short(kind: int, content: bytes) -> bytes:
    return struct.pack("<HH4s", kind, len(content), content)


def variable(shape: tuple[int, ...], name: bytes, content: bytes, kind: int = 1) -> bytes:
    """A variable as it stands in a file, by default cells."""
    return element(14, element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape))
                   + (short if len(name) == 2 else element)(1, name) + content)


def written(path, *variables: bytes):
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(variables))
    return path


def test_a_file_at_which_scipy_ends_the_process_is_one_line(tmp_path):
    """A cell of text is cut off after its name; scipy then reads the next variable as the text."""
    times, text = variable((2, 1), b"", short(4, struct.pack("<HH", 12, 15)), 11), variable((0, 0), bytes(4), b"", 4)
    path = written(tmp_path / "a.mat", variable((1, 2), b"data_processed", times + text),
                   *(variable((1, 1), name, short(5, struct.pack("<i", 9000)), 12) for name in (b"mm", b"MM")))
    assert path.stat().st_size == 416
    with pytest.raises(InvalidInput, match="^a.mat is unreadable .its reader was killed by SIG.*a complete MATLAB"):
        read(path, irf=IRF)


@pytest.mark.parametrize(("said", "most"), [(3_400_000_000, 3 * 2**30), (2**30, 2**29)])
def test_a_compressed_variable_that_takes_too_much_is_refused_before_memory_is_taken(tmp_path, monkeypatch, said, most):
    """The bytes are not even there: room for them is made first."""
    whole = variable((1000, 1000, said // 10**6), b"photons", struct.pack("<II", 2, said), kind=9)
    packed = zlib.compress(whole)
    path = written(tmp_path / "a.mat", struct.pack("<II", 15, len(packed)) + packed)
    monkeypatch.setattr(isolated, "MAX_ARRAY_BYTES", most)
    with pytest.raises(InvalidInput, match="^a.mat: The arrays take more than .* bytes. .* as .npy"):
        read(path, irf=IRF)


def test_a_sparse_array_is_never_in_memory_in_full(tmp_path, monkeypatch):
    """20,000 × 20,000 numbers would be 3.2 GB."""
    counts = csc_matrix(([2.0, 1.0], ([3, 201], [5, 9])), (20_000, 20_000))
    savemat(tmp_path / "a.mat", {"spad": counts, "bin": np.ones((200, 100))}, do_compression=True)
    monkeypatch.setattr(isolated, "MAX_ARRAY_BYTES", 2**24)
    assert (tmp_path / "a.mat").stat().st_size < 1000
    found = read(tmp_path / "a.mat", irf=IRF)
    assert (found.frame.pixel.tolist(), found.frame.toa.tolist()) == ([101, 300, 300], [9, 5, 5])


def test_a_program_from_stdin_reads_in_the_child_too_which_finds_the_same_modules(tmp_path, repository):
    """As in a notebook, __main__ is no file."""
    write(tmp_path, Ts=cells([[[12, 15], []]]))
    program = (f"import sys; sys.path[:1] = [{str(repository)!r}]\nfrom srt3d_ros.datasets import read\n"
               f"print(read('some name.mat', irf={IRF}).frame.toa)\n")
    (tmp_path / "numpy.py").write_text("raise SystemExit('a stranger')")
    done = subprocess.run([sys.executable, "-"], input=program, cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[0 3]\n", "")
