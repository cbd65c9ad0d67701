"""results.csv: what is written is found again, by another run as well."""

import csv

import numpy as np
import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.results import COLUMNS, Results, number

KEY = {"source": "bust", "sbr": 0.1, "ppp": 10.0, "repeat": 1, "method": "pooled", "sketch_size": 10, "surfaces": 1,
       "rows": 141, "cols": 141, "tolerance_bins": 40 / 0.3, "aligned": None}
ROW = KEY | {"dae_mm": 1 / 3, "points": 19_881, "iae": float("nan"), "frequencies": (1, 2, 5)}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results.csv"


def test_a_row_is_on_the_disk_at_once_and_readable_by_any_program(path):
    Results(path).append(ROW)
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 1 and tuple(rows[0]) == COLUMNS
    wanted = {"dae_mm": "0.333333", "points": "19881", "iae": "", "frequencies": "1;2;5", "aligned": "", "sbr": "0.1"}
    assert {name: rows[0][name] for name in wanted} == wanted


def test_another_run_finds_the_rows(path):
    Results(path).append(ROW)
    again = Results(path)
    assert KEY in again and again[KEY]["points"] == "19881"
    assert number(again[KEY], "dae_mm") == pytest.approx(1 / 3, abs=1e-6) and np.isnan(number(again[KEY], "iae"))


@pytest.mark.parametrize("change", [{"method": "rt3d"}, {"sketch_size": None}, {"sbr": 1.0}, {"repeat": 2},
                                    {"tolerance_bins": 10.0}, {"aligned": (2, 8, 60.0)}, {"rows": 71}])
def test_other_settings_are_other_rows(path, change):
    Results(path).append(ROW)
    assert KEY | change not in Results(path)


def test_half_a_line_is_forgotten(path):
    results = Results(path)
    results.append(ROW)
    results.append(ROW | {"repeat": 2})
    path.write_text(path.read_text()[:-30])
    again = Results(path)
    assert KEY in again and KEY | {"repeat": 2} not in again
    again.append(ROW | {"repeat": 2})
    assert len(path.read_text().splitlines()) == 3 and KEY | {"repeat": 2} in Results(path)


def test_fresh_forgets_everything(path):
    Results(path).append(ROW)
    assert KEY not in Results(path, fresh=True) and len(path.read_text().splitlines()) == 1


def test_a_table_of_before_the_methods_were_renamed_is_refused_and_left_alone(path):
    """Its rows of srt3d are of what is called pooled now."""
    Results(path).append(ROW)
    with open(path, newline="") as file:
        header, row = csv.reader(file)
    at = header.index("format")
    for other in (header[:at] + header[at + 1:], row[:at] + row[at + 1:]), (header, [*row[:at], "1", *row[at + 1:]]):
        path.write_text("".join(",".join(line) + "\n" for line in other))
        before = path.read_bytes()
        with pytest.raises(InvalidInput, match="results.csv is .*: expected one by this version: "):
            Results(path)
        assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"\xff\xfe\x00", b"\x89PNG\n"])
def test_a_table_of_something_else_is_refused_and_left_alone(path, content):
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"results.csv is "):
        Results(path)
    assert path.read_bytes() == content
