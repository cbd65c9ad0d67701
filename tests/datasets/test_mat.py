"""Published .mat layouts, on small files written here; the real ones are in test_published.py."""

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from srt3d_ros import read
from srt3d_ros.errors import InvalidInput

ROWS, COLS = 2, 3
IRF = [1.0, 3.0, 1.0]
LISTS = [[[12, 15], [], [10]], [[19], [13, 13, 14], []]]
PIXEL, TOA = [0, 0, 2, 3, 4, 4, 4], [12, 15, 10, 19, 13, 13, 14]
pytestmark = pytest.mark.usefixtures("in_this_process")


def cells(lists, dtype=np.uint16) -> np.ndarray:
    out = np.empty((len(lists), len(lists[0])), object)
    for row, line in enumerate(lists):
        for col, cell in enumerate(line):
            out[row, col] = np.array(cell, dtype).reshape(-1, 1)
    return out


def write(tmp_path, **variables):
    savemat(tmp_path / "some name.mat", variables, do_compression=True)
    return tmp_path / "some name.mat"


@pytest.mark.parametrize(("variable", "dtype"), [("Ts", np.uint16), ("photon_times", np.float64)])
def test_cells_of_bins_are_read_in_row_order(tmp_path, variable, dtype):
    others = {"note": "text", "info": {"a": 1}, "complex": np.array([1 + 2j])}
    path = write(tmp_path, **{variable: cells(LISTS, dtype)}, **others)
    photons = read(path, irf=IRF, num_bins=40)
    assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == (ROWS, COLS, 40)
    assert photons.frame.pixel.tolist() == PIXEL and photons.frame.toa.tolist() == TOA
    assert photons.sensor.bin_width_s == 8e-12 and photons.sensor.toa_offset_bins == 0
    assert photons.frame.is_sorted and photons.name == "some name"
    spanned = read(path, irf=IRF)           # without num_bins the photons span the window
    assert spanned.sensor.num_bins == 10 and spanned.sensor.toa_offset_bins == 10
    assert spanned.frame.toa.tolist() == [toa - 10 for toa in TOA]


def test_picoseconds_become_bins_of_the_window_the_file_states(tmp_path):
    lists = [[[5_000, 5_099, 5_100], [6_000]], [[5_999], []]]
    path = write(tmp_path, data_processed=cells(lists, np.int32), mm=np.int32(5_000), MM=np.int32(6_000))
    photons = read(path, irf=IRF)
    assert photons.sensor.num_bins == 10 and photons.sensor.toa_offset_bins == 50
    assert photons.sensor.bin_width_s == 100e-12
    assert photons.frame.toa.tolist() == [0, 0, 1, 9] and photons.frame.pixel.tolist() == [0, 0, 0, 2]
    assert any("1 of 5 photons lie outside" in note for note in photons.notes)
    finer = read(path, irf=IRF, bin_width_s=50e-12)
    assert finer.sensor.num_bins == 20 and finer.frame.toa.tolist() == [0, 1, 2, 19]


def test_counts_have_column_major_pixels_and_depths_numbered_from_1(tmp_path):
    counts = np.zeros((8, ROWS * COLS), np.uint16)
    for row, line in enumerate([[[1, 5], [], [0]], [[7], [3, 3, 4], []]]):
        for col, cell in enumerate(line):
            np.add.at(counts[:, col * ROWS + row], cell, 1)
    depth = np.arange(1, 7).reshape(ROWS, COLS)
    path = write(tmp_path, Y=counts, DepthImage=depth)
    photons = read(path, irf=IRF)
    assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == (ROWS, COLS, 8)
    assert photons.frame.pixel.tolist() == PIXEL and photons.frame.toa.tolist() == [1, 5, 0, 7, 3, 3, 4]
    np.testing.assert_array_equal(photons.reference_depth_bins, (depth - 1)[None])
    gated = read(path, irf=IRF, gate=(2, 4))
    assert gated.frame.toa.tolist() == [1, 1, 2]
    np.testing.assert_array_equal(gated.reference_depth_bins[0], [[np.nan, np.nan, 0], [1, 2, np.nan]])


def test_what_was_assumed_is_said(tmp_path):
    random = np.random.default_rng(0)
    lists = [[random.normal(300 + 30 * row, 4, 30).astype(int) for _ in range(20)] for row in range(20)]
    photons = read(write(tmp_path, Ts=cells(lists)), num_bins=1000)
    assert [note.split(":")[0] for note in photons.notes] == [
        "bin width taken to be 8 ps", "IRF estimated from the photons, so it is slightly too wide",
        "geometry taken to be a pinhole of 30° across the larger side"]
    assert read(tmp_path / "some name.mat", num_bins=1000, irf=IRF, bin_width_s=1e-12, fov_deg=5).notes == ()


@pytest.mark.parametrize(("variables", "options", "field"), [
    ({"X": np.ones((3, 3))}, {}, ".mat counts"), ({"Ts": np.ones((3, 3))}, {}, ".mat counts"),
    ({"Y": cells(LISTS)}, {}, ".mat counts"), ({"Y": np.full((8, 4), 0.5)}, {}, ".mat Y"),
    ({"Ts": cells(LISTS)}, {"rows": 9}, ".mat rows"),
    ({"Y": np.ones((8, 5)), "DepthImage": np.ones((2, 2))}, {}, ".mat DepthImage shape"),
    ({"spad": csc_matrix(np.eye(4) / 2)}, {}, ".mat spad"), ({"Ts": cells(LISTS)}, {"channel": 1}, ".mat channel"),
    ({"data_processed": cells(LISTS), "mm": np.ones(0), "MM": 3}, {}, ".mat mm"),
    ({"Ts": cells([[[1.5]]], float)}, {}, ".mat Ts"), ({"Ts": cells([[[-1]]], np.int16)}, {}, ".mat Ts ToA"),
    ({"data_processed": cells([[[np.nan]]], float)}, {}, ".mat data_processed ToA"),
    ({"Ts": np.array([[np.ones(1), "d"]], object)}, {}, ".mat Ts cells"),
    ({"Ts": cells(LISTS)}, {"num_bins": 1}, ".mat num_bins"),
    ({"Ts": cells(LISTS)}, {"bin_width_s": 0}, ".mat bin_width_s"),
    ({"Ts": cells(LISTS)}, {"num_bins": "many"}, ".mat num_bins"),
    ({"spad": csc_matrix([[2.0**24, 1.0]]), "bin": 1}, {}, ".mat spad photons"),
    ({"h": np.ones((2, 3, 70_000), np.uint8)}, {}, ".mat counts bins"),
    ({"h": np.ones((2, 3, 9)), "bin_width_s": [1, 2]}, {}, ".mat bin_width_s shape")])
def test_what_cannot_be_used_is_named(tmp_path, variables, options, field):
    with pytest.raises(InvalidInput) as caught:
        read(write(tmp_path, **variables), irf=IRF, **options)
    assert caught.value.field == f"some name{field}"
    assert "\n" not in str(caught.value)
