"""Lists of photons as text."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.errors import InvalidInput

ROW, COL, TOA = np.array([0, 1, 1, 2, 0]), np.array([3, 0, 3, 1, 2]), np.array([5, 70, 6, 7, 8])
KNOWN = {"irf": [1, 2, 1], "fov_deg": 10, "bin_width_s": 1e-10}


def written(path, header, *columns):
    lines = [";".join(map(str, line)) for line in zip(*columns)]
    text = "\n".join([header, *lines, ""])
    path.write_text(text if ";" in header else text.replace(";", "\t" if "\t" in header else ","))
    return path


@pytest.mark.parametrize(("header", "columns", "options"), [
    ("row,col,toa", (ROW, COL, TOA), {}), ("frame,X,Y,t", (TOA, COL, ROW, TOA), {}),
    ('"x";"y";"ToA [ns]"', (COL, ROW, [f"{toa / 10:.1f}".replace(".", ",") for toa in TOA]), {}),
    ("t_ps\tcol\trow", (TOA * 100, COL, ROW), {}), ("# pixel,toa", (ROW * 4 + COL, TOA), {}),
    ("a,b,c", (COL, TOA, ROW), {"columns": "c,a,b"})])
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
def test_what_cannot_be_read_is_one_line(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InvalidInput) as refused:
        read(tmp_path / "a.csv", **KNOWN)
    assert str(refused.value).startswith(said)


def test_times_in_a_unit_need_the_bin_width(tmp_path):
    with pytest.raises(InvalidInput, match=r"^a.csv: t_us is in us: give bin_width_s"):
        read(written(tmp_path / "a.csv", "row,col,t_us", ROW, COL, TOA))
