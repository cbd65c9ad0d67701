"""Published .mat layouts, on small files written here; the real ones are in test_published.py."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.datasets import open_photons
from srt3d_ros.errors import InvalidInput

ROWS, COLS = 2, 3
IRF = [1.0, 3.0, 1.0]
LISTS = [[[12, 15], [], [10]], [[19], [13, 13, 14], []]]
PIXEL, TOA = [0, 0, 2, 3, 4, 4, 4], [12, 15, 10, 19, 13, 13, 14]


def cells(lists, dtype=np.uint16) -> np.ndarray:
    out = np.empty((len(lists), len(lists[0])), object)
    for row, line in enumerate(lists):
        for col, cell in enumerate(line):
            out[row, col] = np.array(cell, dtype).reshape(-1, 1)
    return out


def write(tmp_path, name="some name.mat", **variables):
    savemat(tmp_path / name, variables, do_compression=True)
    return tmp_path / name


@pytest.mark.parametrize("variable", ["Ts", "photon_times"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float64])
def test_cells_of_bins_are_read_in_row_order(tmp_path, variable, dtype):
    photons = open_photons(write(tmp_path, **{variable: cells(LISTS, dtype)}), irf=IRF, num_bins=40)
    assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == (ROWS, COLS, 40)
    assert photons.frame.pixel.tolist() == PIXEL and photons.frame.toa.tolist() == TOA
    assert photons.sensor.bin_width_s == 8e-12 and photons.sensor.toa_offset_bins == 0
    assert photons.frame.is_sorted and photons.name == "some name"


def test_without_num_bins_the_photons_span_the_window(tmp_path):
    photons = open_photons(write(tmp_path, Ts=cells(LISTS)), irf=IRF)
    assert photons.sensor.num_bins == 10 and photons.sensor.toa_offset_bins == 10
    assert photons.frame.toa.tolist() == [toa - 10 for toa in TOA]


def test_a_gate_drops_and_counts_photons_outside(tmp_path):
    path = write(tmp_path, Ts=cells(LISTS))
    photons = open_photons(path, irf=IRF, gate=(12, 4), toa_offset_bins=100, bin_width_s=1e-12)
    assert photons.frame.toa.tolist() == [0, 3, 1, 1, 2] and photons.sensor.num_bins == 4
    assert photons.sensor.toa_offset_bins == 112
    assert photons.notes == ("2 of 7 photons lie outside the gate (bins 12 to 15): dropped",)


def test_picoseconds_become_bins_of_the_window_the_file_states(tmp_path):
    lists = [[[5_000, 5_099, 5_100], [6_000]], [[5_999], []]]
    path = write(tmp_path, data_processed=cells(lists, np.int32), mm=np.int32(5_000), MM=np.int32(6_000))
    photons = open_photons(path, irf=IRF)
    assert photons.sensor.num_bins == 10 and photons.sensor.toa_offset_bins == 50
    assert photons.sensor.bin_width_s == 100e-12
    assert photons.frame.toa.tolist() == [0, 0, 1, 9] and photons.frame.pixel.tolist() == [0, 0, 0, 2]
    assert any("1 of 5 photons lie outside" in note for note in photons.notes)
    finer = open_photons(path, irf=IRF, bin_width_s=50e-12)
    assert finer.sensor.num_bins == 20 and finer.frame.toa.tolist() == [0, 1, 2, 19]


def test_counts_have_column_major_pixels_and_depths_numbered_from_1(tmp_path):
    counts = np.zeros((8, ROWS * COLS), np.uint16)
    for row, line in enumerate([[[1, 5], [], [0]], [[7], [3, 3, 4], []]]):
        for col, cell in enumerate(line):
            np.add.at(counts[:, col * ROWS + row], cell, 1)
    depth = np.arange(1, 7).reshape(ROWS, COLS)
    photons = open_photons(write(tmp_path, Y=counts, DepthImage=depth), irf=IRF)
    assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == (ROWS, COLS, 8)
    assert photons.frame.pixel.tolist() == PIXEL and photons.frame.toa.tolist() == [1, 5, 0, 7, 3, 3, 4]
    np.testing.assert_array_equal(photons.reference_depth_bins, (depth - 1)[None])
    edge = open_photons(tmp_path / "some name.mat", irf=IRF, toa_reference="bin_edge")
    np.testing.assert_array_equal(edge.reference_depth_bins, (depth - 0.5)[None])       # the centres of these bins
    gated = open_photons(tmp_path / "some name.mat", irf=IRF, gate=(3, 5))
    assert gated.frame.toa.tolist() == [2, 4, 0, 0, 1]
    np.testing.assert_array_equal(gated.reference_depth_bins[0], [[np.nan, np.nan, np.nan], [0, 1, 2]])


def test_the_shape_of_counts_is_given_or_square(tmp_path):
    path = write(tmp_path, Y=np.ones((8, 16), np.uint8))
    assert open_photons(path, irf=IRF).sensor.rows == 4
    assert open_photons(path, irf=IRF, rows=2, cols=8).sensor.cols == 8
    with pytest.raises(InvalidInput, match="rows, cols"):
        open_photons(path, irf=IRF, rows=3, cols=5)


def test_what_was_assumed_is_said(tmp_path):
    random = np.random.default_rng(0)
    lists = [[random.normal(300 + 30 * row, 4, 30).astype(int) for _ in range(20)] for row in range(20)]
    photons = open_photons(write(tmp_path, Ts=cells(lists)), num_bins=1000)
    assert [note.split(":")[0] for note in photons.notes] == [
        "bin width taken to be 8 ps", "IRF estimated from the photons, which makes it slightly broad"]
    assert open_photons(tmp_path / "some name.mat", num_bins=1000, irf=IRF, bin_width_s=1e-12).notes == ()


FILES = {
    "no photons in it": ({"X": np.ones((3, 3))}, {}, "variables"),
    "counts where cells belong": ({"Ts": np.ones((3, 3))}, {}, "variables"),
    "cells where counts belong": ({"Y": cells(LISTS)}, {}, "variables"),
    "negative counts": ({"Y": -np.ones((8, 4), np.int16)}, {}, "Y"),
    "half counts": ({"Y": np.full((8, 4), 0.5)}, {}, "Y"),
    "too many counts": ({"Y": np.full((8, 4), 2**30)}, {}, "Y photons"),
    "not square": ({"Y": np.ones((8, 5))}, {}, "rows, cols"),
    "text cells": ({"Ts": np.array([["abc", "d"]], object)}, {}, "Ts cells"),
    "half bins": ({"Ts": cells([[[1.5]]], float)}, {}, "Ts"),
    "NaN bins": ({"Ts": cells([[[np.nan]]], float)}, {}, "Ts"),
    "negative bins": ({"Ts": cells([[[-1]]], np.int16)}, {}, "Ts ToA"),
    "NaN picoseconds": ({"data_processed": cells([[[np.nan]]], float)}, {}, "data_processed"),
    "rows that disagree": ({"Ts": cells(LISTS)}, {"rows": 9}, "rows, cols"),
}


@pytest.mark.parametrize(("variables", "options", "field"), FILES.values(), ids=FILES)
def test_unusable_files_are_named(tmp_path, variables, options, field):
    with pytest.raises(InvalidInput) as caught:
        open_photons(write(tmp_path, **variables), irf=IRF, **options)
    assert caught.value.field == f"some name.mat {field}"
    assert "\n" not in str(caught.value)


OPTIONS = {
    "T too small": ({"num_bins": 15}, "num_bins"), "T of 1": ({"num_bins": 1}, "num_bins"),
    "T of text": ({"num_bins": "many"}, "num_bins"), "T too large": ({"num_bins": 10**6}, "num_bins"),
    "bin width 0": ({"bin_width_s": 0}, "bin_width_s"), "bin width of text": ({"bin_width_s": "1 ps"}, "bin_width_s"),
    "gate of one number": ({"gate": (3,)}, "gate"), "gate of text": ({"gate": "all"}, "gate"),
    "negative gate": ({"gate": (-1, 20)}, "gate"), "half a gate": ({"gate": (0.5, 20)}, "gate"),
    "IRF too long": ({"irf": np.ones(41)}, "irf length"), "negative IRF": ({"irf": [-1, 1]}, "irf"),
    "IRF of text": ({"irf": ["a"]}, "irf"), "IRF reference outside": ({"irf_ref": 9}, "irf_ref"),
    "field of view": ({"fov_deg": 180}, "fov_deg"), "unknown": ({"bins": 3}, "option name"),
}


@pytest.mark.parametrize(("options", "field"), OPTIONS.values(), ids=OPTIONS)
def test_unusable_options_are_named(tmp_path, options, field):
    with pytest.raises(InvalidInput) as caught:
        open_photons(write(tmp_path, Ts=cells(LISTS)), **({"irf": IRF, "num_bins": 40} | options))
    assert caught.value.field == field


def test_photons_that_do_not_cluster_give_no_irf(tmp_path):
    random = np.random.default_rng(0)
    lists = [[random.integers(0, 1000, 30) for _ in range(20)] for _ in range(20)]
    with pytest.raises(InvalidInput, match="give irf"):
        open_photons(write(tmp_path, Ts=cells(lists)))
    with pytest.raises(InvalidInput, match="give irf"):
        open_photons(write(tmp_path, Ts=cells([[[], []]])), num_bins=10)


@pytest.mark.parametrize("damage", [
    lambda data: data[:-5], lambda data: data[:100], lambda data: b"", lambda data: b"x" * 500,
    lambda data: data[:140] + bytes(40) + data[180:],
])
def test_damaged_files_are_refused(tmp_path, damage):
    path = write(tmp_path, Ts=cells(LISTS))
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InvalidInput, match="^some name.mat"):
        open_photons(path, irf=IRF)


def test_every_truncation_is_one_line(tmp_path):
    path = write(tmp_path, Ts=cells(LISTS))
    data = path.read_bytes()
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        with pytest.raises(InvalidInput):
            open_photons(path, irf=IRF)


def test_a_matlab_7_3_file_says_what_to_do(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + bytes(384) + b"\x89HDF")
    with pytest.raises(InvalidInput, match=r"7\.3 \(HDF5\) file: expected .* save it with -v7"):
        open_photons(path)


def test_a_compressed_bomb_is_refused_before_it_unpacks(tmp_path):
    path = tmp_path / "a.mat"
    body = zlib.compress(struct.pack("<II", 14, 2**31) + bytes(2**20))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(header + struct.pack("<II", 15, len(body)) + body)
    with pytest.raises(InvalidInput, match="2147483784 bytes unpacked"):
        open_photons(path)


def of_cells(dimensions: tuple[int, int], content: bytes = b"", kind: int = 1) -> bytes:
    """A variable Ts, as it stands in a file."""
    parts = [(6, struct.pack("<II", kind, 0)), (5, struct.pack("<ii", *dimensions)), (1, b"Ts")]
    body = b"".join(struct.pack("<II", code, len(part)) + part.ljust(-(-len(part) // 8) * 8, b"\0")
                    for code, part in parts) + content
    return struct.pack("<II", 14, len(body)) + body


def written(path, variable: bytes, compressed: bool):
    packed = zlib.compress(variable)
    element = struct.pack("<II", 15, len(packed)) + packed if compressed else variable
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element)
    return path


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("dimensions", [(2**12, 2**14), (2**31 - 1, 2**31 - 1), (2**31 - 1, 0), (-1, -1)])
def test_cells_that_are_not_there_take_no_room(tmp_path, compressed, dimensions):
    path = written(tmp_path / "a.mat", of_cells(dimensions), compressed)
    tracemalloc.start()
    with pytest.raises(InvalidInput, match="^a.mat "):
        open_photons(path, irf=IRF)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5_000_000


@pytest.mark.parametrize("code", [0, 8, 10, 11, 19, 99])
def test_a_checksum_does_not_vouch_for_what_is_compressed(tmp_path, code):
    number = of_cells((1, 1), struct.pack("<II8s", code, 2, b"\x0c"), kind=11)
    path = written(tmp_path / "a.mat", of_cells((1, 1), number), True)
    with pytest.raises(InvalidInput, match="^a.mat is damaged"):
        open_photons(path, irf=IRF)


def test_structures_beside_the_photons_are_never_shown_to_the_reader(tmp_path):
    good = of_cells((1, 1), of_cells((1, 1), struct.pack("<II8s", 4, 2, b"\x0c"), kind=11))
    path = written(tmp_path / "a.mat", good, True)
    path.write_bytes(path.read_bytes() + of_cells((2**31 - 1, 2**31 - 1), kind=17))     # an opaque object
    assert open_photons(path, irf=IRF, num_bins=20).frame.toa.tolist() == [12]


def test_photons_of_one_pixel_keep_their_values_whatever_the_type(tmp_path):
    photons = open_photons(write(tmp_path, Ts=cells([[[60_000, 65_000]]], np.int32)), irf=IRF)
    assert isinstance(photons.frame, PhotonEvents) and photons.frame.toa.tolist() == [0, 5000]


@pytest.mark.parametrize("byte", [0, 1, 11, 128, 255])
def test_no_changed_byte_of_an_uncompressed_file_crashes_the_reader(tmp_path, byte):
    savemat(tmp_path / "a.mat", {"Ts": cells([[[12, 15, 10], []]])}, do_compression=False)
    data = (tmp_path / "a.mat").read_bytes()
    assert open_photons(tmp_path / "a.mat", irf=IRF).frame.photons == 3
    refused = 0
    for at in range(128, len(data)):
        (tmp_path / "a.mat").write_bytes(data[:at] + bytes([byte]) + data[at + 1:])
        try:
            open_photons(tmp_path / "a.mat", irf=IRF)
        except InvalidInput as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 20


def test_other_variables_are_no_obstacle(tmp_path):
    variables = {"Ts": cells(LISTS), "note": "text", "info": {"a": 1}, "complex": np.array([1 + 2j])}
    for compressed in (True, False):
        savemat(tmp_path / "a.mat", variables, do_compression=compressed)
        assert open_photons(tmp_path / "a.mat", irf=IRF).frame.photons == 7
