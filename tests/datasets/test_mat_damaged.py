"""Damaged .mat files, read as users have them read: in a child process, whose end is one line here."""

import struct
import subprocess
import sys

import pytest

from srt3d_ros.datasets import read
from srt3d_ros.errors import InvalidInput
from tests.datasets.test_mat import IRF, cells, write


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    path = write(tmp_path, Ts=cells([[[12, 15], []]]))
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(InvalidInput, match="^some name.mat is unreadable"):
        read(path, irf=IRF)


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content.ljust(-(-len(content) // 8) * 8, b"\0")


def of_cells(dimensions: tuple[int, int], content: bytes = b"", kind: int = 1) -> bytes:
    """A variable Ts, as it stands in a file."""
    return element(14, element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", *dimensions))
                   + element(1, b"Ts") + content)


def of_object() -> bytes:
    """A variable that holds an object of a class, which has no dimensions in the file."""
    numbers = element(14, element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"")
                      + element(6, struct.pack("<II", 0xDD000000, 1)))
    return element(14, element(6, struct.pack("<II", 17, 0)) + element(1, b"info") + element(1, b"MCOS")
                   + element(1, b"string") + numbers)


def written(path, *variables: bytes):
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(variables))
    return path


def test_a_file_at_which_scipy_ends_the_process_is_one_line(tmp_path):
    cell = of_cells((1, 1), struct.pack("<HH4s", 99, 4, b"\x0c"), kind=11)      # MATLAB has no such type code
    with pytest.raises(InvalidInput) as caught:
        read(written(tmp_path / "a.mat", of_cells((1, 1), cell)), irf=IRF)
    assert str(caught.value).startswith("a.mat is unreadable (its reader was killed by SIG")


def test_a_script_without_a_main_guard_reads_in_the_child_too(tmp_path, repository):
    """From another folder; the modules of this process are found, and none in the working directory."""
    write(tmp_path, Ts=cells([[[12, 15], []]]))
    (tmp_path / "numpy.py").write_text("raise SystemExit('a stranger')")
    (tmp_path / "scripts").mkdir()
    script = tmp_path / "scripts" / "script.py"
    script.write_text(f"import sys\nsys.path.append({str(repository)!r})\nfrom srt3d_ros.datasets import read\n"
                      f"print(read('some name.mat', irf={IRF}).frame.toa)\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[0 3]\n", "")


def test_objects_beside_the_photons_are_not_read(tmp_path):
    good = of_cells((1, 1), of_cells((1, 1), struct.pack("<II8s", 4, 2, b"\x0c"), kind=11))
    for variables in ((good, of_object()), (of_object(), good)):
        path = written(tmp_path / "a.mat", *variables)
        assert read(path, irf=IRF, num_bins=20).frame.toa.tolist() == [12]
    with pytest.raises(InvalidInput, match="a.mat variables is others, some of them objects"):
        read(written(path, of_object()), irf=IRF)
