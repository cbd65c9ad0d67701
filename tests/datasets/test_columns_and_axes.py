"""Photons as arrays of row, col and ToA, and counts with other axes: the same from every kind of file."""

import re

import numpy as np
import pytest

from srt3d_ros import datasets, from_counts, read
from srt3d_ros.errors import InvalidInput
from tests.datasets.laboratory_files import pulse_cube, write

CUBE = pulse_cube()
IRF = [0.1, 0.25, 0.3, 0.25, 0.1]
ROW, COL, TOA = [0, 2, 1, 2], [3, 0, 1, 3], [5, 49, 0, 7]
SIZES = {"rows": 3, "cols": 4, "num_bins": 50}
pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_rows_columns_and_times_are_read_by_their_names_or_by_those_given(tmp_path, suffix):
    own = write(tmp_path / f"own{suffix}", {"row": ROW, "col": COL, "toa": TOA, "irf": IRF} | SIZES)
    photons = read(own)
    assert photons.frame.pixel.tolist() == [3, 8, 5, 11] and photons.frame.toa.tolist() == TOA
    assert photons.sensor.pixels == 12 and np.allclose(photons.sensor.irf, IRF)
    other = write(tmp_path / f"other{suffix}", {"x": COL, "y": np.float64(ROW), "t": TOA, "toa": [1, 2], "more": CUBE})
    for columns in ("y,x,t", ["y", "x", "t"]):
        named = read(other, columns=columns, irf=IRF, shape=(3, 4), num_bins=50)
        assert named.sensor.same_as(photons.sensor)
        np.testing.assert_array_equal(named.frame.pixel, photons.frame.pixel)
        np.testing.assert_array_equal(named.frame.toa, photons.frame.toa)


@pytest.mark.parametrize(("arrays", "options", "said"), [
    ({"t": TOA, "hits": np.ones((2, 4), np.int8)}, {},
     r"The file needs one numeric array.*--columns ROW,COL,TOA, or srt3d_ros.from_events.*"
     r"It has t \(4 int64\), hits \(2×4 int8\)\."),
    ({"row": ROW, "col": COL, "toa": TOA}, {"rows": 3, "cols": 4}, r"The file has no num_bins: .* It has row \(4 "),
    ({"row": ROW, "toa": TOA}, SIZES, r"The file has no col\. It needs .*It has row \(4 int64\), toa"),
    ({"a": ROW, "b": [{}]}, SIZES | {"columns": "a,x,c"}, r"The file has no x\. .* It has a \(4 .*, b \(unreadable\)")])
def test_what_is_missing_is_named_and_what_is_there_listed(tmp_path, arrays, options, said):
    np.savez(tmp_path / "a.npz", **{name: np.array(values) for name, values in arrays.items()})
    with pytest.raises(InvalidInput, match=f"^a.npz:? {said}"):
        read(tmp_path / "a.npz", irf=IRF, **options)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".h5", ".mat", "array"])
def test_axes_say_where_rows_columns_and_bins_are(tmp_path, suffix):
    turned = np.ascontiguousarray(CUBE.transpose(2, 1, 0))
    given = {"irf": IRF, "bin_width_s": 1e-10, "fov_deg": 20, "toa_offset_bins": 0.5}
    for axes in ("bins,cols,rows", ("bins", "cols", "rows")):
        photons = (from_counts(turned, axes=axes, **given) if suffix == "array" else
                   read(write(tmp_path / f"a{suffix}", {"counts": turned}), axes=axes, **given))
        assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == CUBE.shape
        assert photons.notes == ()
        sums = photons.sketch(frequencies=(1, 5)).sums.reshape(6, 8, 2)
        np.testing.assert_allclose(sums, from_counts(CUBE, **given).sketch(frequencies=(1, 5)).sums.reshape(6, 8, 2),
                                   atol=2e-3)


ORDERS = [("rows,bins,cols", (0, 2, 1)), ("bins,rows,cols", (2, 0, 1)), ("bins,cols,rows", (2, 1, 0))]


@pytest.mark.parametrize(("axes", "order"), ORDERS)
@pytest.mark.parametrize(("suffix", "name"), [(".npz", "cube"), (".npz", "counts"), (".h5", "cube"), (".mat", "cube")])
def test_the_sizes_that_a_file_states_order_the_axes(tmp_path, suffix, name, axes, order):
    stated = {"rows": 6, "cols": 8, "num_bins": 120, "bin_width_s": 1e-10, "irf": IRF, "fov_deg": 20}
    path = write(tmp_path / f"a{suffix}", {name: np.ascontiguousarray(CUBE.transpose(order))} | stated)
    photons = read(path)
    assert axes in photons.notes[0] and (photons.sensor.rows, photons.sensor.cols) == (6, 8)
    np.testing.assert_allclose(photons.sketch(frequencies=(1, 5)).sums,
                               from_counts(CUBE, irf=IRF).sketch(frequencies=(1, 5)).sums, atol=2e-3)
    turned = from_counts(CUBE.transpose(order), irf=IRF, rows=6, cols=8)
    assert turned.sensor.num_bins == 120 and axes in str(turned.notes)


def test_sizes_that_fit_no_order_or_several_are_refused(tmp_path):
    square = write(tmp_path / "a.npz", {"c": np.ones((30, 6, 6)), "rows": 6, "cols": 6, "num_bins": 30, "irf": IRF})
    with pytest.raises(InvalidInput, match="30 × 6 × 6 counts may be bins,rows,cols or bins,cols,rows .*--axes"):
        read(square)
    assert read(square, axes="bins,rows,cols").sensor.num_bins == 30
    with pytest.raises(InvalidInput, match="bins,rows,cols or bins,cols,rows"):
        from_counts(CUBE.transpose(2, 0, 1), irf=[1], num_bins=120)
    none = write(tmp_path / "b.npz", {"c": CUBE, "rows": 6, "cols": 9, "num_bins": 120, "irf": IRF})
    for options in ({}, {"axes": "rows,cols,bins"}):
        with pytest.raises(InvalidInput, match="6 × 8 × 120: expected axes that fit rows = 6, cols = 9, num_bins"):
            read(none, **options)


@pytest.mark.parametrize(("shape", "orders"), [
    ((6, 50, 8), "axes=rows,bins,cols"), ((50, 6, 8), "axes=bins,rows,cols, or bins,cols,rows"),
    ((8, 20, 20), "axes=bins,rows,cols, or bins,cols,rows"), ((20, 20, 8), "bins,cols,rows .*; or rows,bins,cols"),
    ((6, 8, 50), ""), ((30, 30, 30), "")])
def test_an_order_in_doubt_is_noted_with_those_that_fit(shape, orders):
    notes = from_counts(np.ones(shape), irf=[1], fov_deg=9, bin_width_s=1e-12).notes
    assert len(notes) == bool(orders) and all(re.search(orders, note) for note in notes)
    assert from_counts(np.ones(shape), irf=[1], fov_deg=9, bin_width_s=1e-12, num_bins=shape[2]).notes == ()


@pytest.mark.parametrize("suffix", [".nc", "array"])
def test_names_of_dimensions_order_the_axes(tmp_path, suffix):
    dims = ("Time", "x", "y")
    if suffix == "array":
        turned = CUBE.transpose(2, 1, 0).view(type("DataArray", (np.ndarray,), {"dims": dims}))
        photons = from_counts(turned, irf=IRF)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(tmp_path / "a.nc", "w") as file:
            file["photons"] = CUBE.transpose(2, 1, 0)
            for axis, (name, size) in enumerate(zip(dims, CUBE.shape[::-1])):
                file[name] = np.arange(size)
                file[name].make_scale(name)
                file["photons"].dims[axis].attach_scale(file[name])
        photons = read(tmp_path / "a.nc", irf=IRF)
    assert (photons.sensor.rows, photons.sensor.cols, photons.sensor.num_bins) == CUBE.shape


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_a_picture_is_no_array_of_counts_and_one_of_several_is_chosen(tmp_path, suffix):
    picture = np.full((20, 30, 3), 200, np.uint8)
    path = write(tmp_path / f"a{suffix}", {"histogram": CUBE[None], "reference": picture})
    assert read(path, irf=IRF).photons == CUBE.sum()
    two = write(tmp_path / f"b{suffix}", {"one": CUBE, "two": 2 * CUBE, "reference": picture})
    with pytest.raises(InvalidInput, match=r"or array \(--array NAME\).* It has .*reference \(20×30×3 uint8"):
        read(two, irf=IRF)
    assert read(two, irf=IRF, array="two").photons == 2 * CUBE.sum()
    with pytest.raises(InvalidInput, match="has no three. It has"):
        read(two, irf=IRF, array="three")


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".h5", ".mat"])
def test_an_array_of_four_axes_has_frames(tmp_path, suffix, monkeypatch):
    frames = np.stack([CUBE, CUBE + (CUBE > 0)])
    path = write(tmp_path / f"a{suffix}", {"counts": frames})
    for frame in (0, 1):
        photons = read(path, frame, irf=IRF, fov_deg=9, bin_width_s=1e-12)
        assert photons.photons == frames[frame].sum()
        assert photons.notes == (() if frame else ("frame 0 of 2 (--frame)",))
    assert datasets.frame_numbers(path, "all") == range(2)
    with pytest.raises(InvalidInput, match="frame is 2: expected less than 2"):
        read(path, 2, irf=IRF)
    last = write(tmp_path / f"b{suffix}", {"counts": frames.transpose(1, 2, 3, 0)})
    assert read(last, 1, axes="rows,cols,bins,frames", irf=IRF).photons == frames[1].sum()
    with pytest.raises(InvalidInput, match="expected numbers .* of one frame"):
        from_counts(frames, irf=IRF)


def test_an_irf_that_is_too_long_for_turned_counts_names_axes():
    with pytest.raises(InvalidInput, match=r"^The IRF is longer than the period: 120 × 8 × 6 taken for .*--axes"):
        from_counts(CUBE.transpose(2, 1, 0), irf=np.ones(7))


@pytest.mark.parametrize(("options", "said"), [
    ({"mask": "hot"}, 'mask is "hot": expected auto, off, or an array'),
    ({"axes": "bins,rows"}, "axes is .*: expected rows, cols and bins in the order of the array"),
    ({"axes": ("bins", "rows", "rows")}, "axes is .*: expected rows, cols and bins"), ({"axes": 3}, "axes is 3: "),
    ({"columns": "a,b,c,d"}, "columns is .*: expected the arrays"), ({"columns": [1, 2, 3]}, "columns"),
    ({"columns": "a,b,c"}, "Only .npz, HDF5, .mat"), ({"channel": 1}, "Only .ptu, .phu, .sdt"),
    ({"reversed": True}, "Only photon files have reversed")])
def test_options_for_other_files_are_refused(tmp_path, options, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        from_counts(CUBE, irf=IRF, **options)


# ---- Lists of photons as text

ROWS, COLS, TIMES = np.array([0, 1, 1, 2, 0]), np.array([3, 0, 3, 1, 2]), np.array([5, 70, 6, 7, 8])
KNOWN = {"irf": [1, 2, 1], "fov_deg": 10, "bin_width_s": 1e-10}


def written(path, header, *columns):
    lines = [";".join(map(str, line)) for line in zip(*columns)]
    text = "\n".join([header, *lines, ""])
    path.write_text(text if ";" in header else text.replace(";", "\t" if "\t" in header else ","))
    return path


@pytest.mark.parametrize(("header", "columns", "options"), [
    ("row,col,toa", (ROWS, COLS, TIMES), {}), ("frame,X,Y,t", (TIMES, COLS, ROWS, TIMES), {}),
    ('"x";"y";"ToA [ns]"', (COLS, ROWS, [f"{toa / 10:.1f}".replace(".", ",") for toa in TIMES]), {}),
    ("t_ps\tcol\trow", (TIMES * 100, COLS, ROWS), {}), ("# pixel,toa", (ROWS * 4 + COLS, TIMES), {}),
    ("a,b,c", (COLS, TIMES, ROWS), {"columns": "c,a,b"})])
def test_the_header_names_row_column_and_time(tmp_path, header, columns, options):
    photons = read(written(tmp_path / "a.csv", header, *columns), num_bins=80, rows=3, cols=4, **KNOWN, **options)
    assert (photons.sensor.rows, photons.sensor.cols) == (3, 4)
    order = np.argsort(photons.frame.toa)
    assert photons.frame.pixel[order].tolist() == [3, 7, 9, 2, 4] and photons.frame.toa.dtype == np.uint16
    assert photons.frame.toa[order].tolist() == [5, 6, 7, 8, 70]


def test_times_between_bins_are_kept(tmp_path):
    path = written(tmp_path / "a.csv", "x,y,t_ns", [0, 1], [0, 0], [0.25, 1.13])
    photons = read(path, rows=1, cols=2, num_bins=12, **KNOWN)
    np.testing.assert_allclose(photons.frame.toa, [2.5, 11.3], rtol=1e-6)
    alone = read(tmp_path / "a.csv", columns="t_ns", num_bins=20, **KNOWN)
    assert alone.sensor.pixels == 1 and alone.photons == 2 and alone.notes == ()


@pytest.mark.parametrize(("text", "said"), [
    ("time,counts\n0,3\n", "a.csv: The file has no column row. Its first line must name row, col"),
    ("0,1,2\n0,1,3\n", "a.csv: The file has no column row"), ("row,col,toa\n", "a.csv: The file has no photons."),
    ("row,col,toa\n1,2,far\n", "a.csv is unreadable"), ("row,col,toa\n1,-2,3\n", "a.csv: The file has no rows: give"),
    ("", "a.csv: The file has no column"),
    ("pixel,toa\n3,4\n", "a.csv: The file has no rows"), ("row,col,toa\n1,2,nan\n", "a.csv")])
@pytest.mark.filterwarnings("error")
def test_a_text_that_cannot_be_read_is_one_line(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InvalidInput) as refused:
        read(tmp_path / "a.csv", **KNOWN)
    assert str(refused.value).startswith(said)


def test_times_in_a_unit_need_the_bin_width(tmp_path):
    with pytest.raises(InvalidInput, match=r"^a.csv: t_us is in us: give bin_width_s"):
        read(written(tmp_path / "a.csv", "row,col,t_us", ROWS, COLS, TIMES))
