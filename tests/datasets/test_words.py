"""Raw words of a SPAD array: one ToA word a frame and pixel."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.errors import InvalidInput
from tests.datasets.laboratory_files import counts_of, write

OPTIONS = {"irf": [1, 2, 1], "num_bins": 50, "bin_width_s": 1e-10, "fov_deg": 10, "toa_offset_bins": 0}
FRAMES, ROWS, COLS = 200, 3, 4


def words(first_word=0, no_detection=255) -> tuple[np.ndarray, np.ndarray]:
    """Words uint16 [frames, rows, cols] and the counts [rows, cols, bins] of their photons."""
    rng = np.random.default_rng(1)
    toa, seen = rng.integers(0, 50, (FRAMES, ROWS, COLS)), rng.random((FRAMES, ROWS, COLS)) < 0.04
    counts = np.zeros((ROWS, COLS, 50), int)
    _, row, col = np.nonzero(seen)
    np.add.at(counts, (row, col, toa[seen]), 1)
    return np.where(seen, toa + first_word, no_detection).astype(np.int32), counts


@pytest.mark.parametrize("kind", [".npy", ".npz", ".mat", ".h5"])
@pytest.mark.parametrize(("first_word", "no_detection"), [(0, 255), (1, 0), (7, -1), (100, 65_535)])
def test_the_photons_of_all_frames_are_added_up(tmp_path, monkeypatch, kind, first_word, no_detection):
    monkeypatch.setattr("srt3d_ros.datasets.named_arrays.WORDS_AT_ONCE", 300)
    raw, counts = words(first_word, no_detection)
    name = "scan/words" if kind == ".h5" else "words"
    path = write(tmp_path / f"a{kind}", {name: raw.astype(float) if kind == ".mat" else raw} | (
        {"bin_width_s": 2e-10} if kind == ".npz" else {}))
    photons = read(path, no_detection=no_detection, first_word=first_word, **OPTIONS)
    np.testing.assert_array_equal(counts_of(photons), counts)
    assert photons.frame.is_sorted and photons.frame.toa.dtype == np.uint16
    assert photons.notes == (("as given, not as in the file: bin_width_s",) if kind == ".npz" else ())


def test_axes_gates_and_words_that_are_no_bins(tmp_path):
    raw, counts = words()
    np.save(tmp_path / "a.npy", raw.transpose(1, 2, 0).astype(float))
    photons = read(tmp_path / "a.npy", no_detection=255, axes="rows,cols,frames", gate=(10, 29), **OPTIONS)
    np.testing.assert_array_equal(counts_of(photons), counts[..., 10:30])
    raw[:2, 0, 0] = 60, -7
    np.save(tmp_path / "a.npy", raw)
    assert "2 of " in read(tmp_path / "a.npy", no_detection=255, **OPTIONS).notes[0]


def test_many_photons_a_frame_ask_for_cycles(tmp_path):
    np.save(tmp_path / "a.npy", np.full((100, 2, 2), 9, np.uint8))
    assert "give cycles=100 (--cycles)" in read(tmp_path / "a.npy", no_detection=0, **OPTIONS).notes[0]
    assert not read(tmp_path / "a.npy", no_detection=0, cycles=100, **OPTIONS).notes


@pytest.mark.parametrize(("array", "options", "said"), [
    (np.zeros((9, 4)), {"no_detection": 0}, r"a.npy words is float64 \(9, 4\): expected numbers"),
    (np.zeros((9, 4, 4)), {"no_detection": 0, "axes": "bins,rows,cols"}, "a.npy axes is bins,rows,cols: expected fr"),
    (np.zeros((9, 4, 4)), {"no_detection": 0, "rows": 5}, "a.npy rows is 5: expected 4, as in the file"),
    (np.zeros((9, 4, 4)), {"first_word": 3}, "a.npy: first_word needs no_detection, and a file"),
    (np.full((9, 4, 4), 99), {"no_detection": 0}, "a.npy: 144 of 144 photons lie outside 0 to below 50 bins"),
    (np.zeros((9, 4, 4)), {"no_detection": 255, "num_bins": None}, "a.npy: The file has no num_bins")])
def test_what_cannot_be_read_is_one_line(tmp_path, array, options, said):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InvalidInput, match=f"^{said}"):
        read(tmp_path / "a.npy", **OPTIONS | options)
