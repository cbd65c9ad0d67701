"""results.csv: what is written is found again, by another run as well; and the table made of it."""

import csv

import numpy as np
import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.results import COLUMNS, HEADINGS, Results, averaged, markdown, number

KEY = {"source": "bust", "sbr": 0.1, "ppp": 10.0, "repeat": 1, "method": "pooled", "sketch_size": 10, "surfaces": 1,
       "rows": 141, "cols": 141, "tolerance_bins": 40 / 0.3, "aligned": None}
ROW = KEY | {"dae_mm": 1 / 3, "points": 19_881, "iae": float("nan"), "frequencies": (1, 2, 5)}
READ = dict.fromkeys(COLUMNS, "") | {"source": "bust", "sbr": "1", "ppp": "10", "repeat": "1", "method": "pooled",
                                     "sketch_size": "10", "photons_per_pixel": "9.9", "points": "100"}
JUDGED = READ | {"true_detections_percent": "90", "true_detections_by_surface_percent": "90", "dae_mm": "2",
                 "within_nominal_percent": "10;50"}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results.csv"


def test_a_row_is_on_the_disk_at_once_and_found_by_any_program_and_another_run(path):
    Results(path).append(ROW)
    with open(path, newline="") as file:
        row, = csv.DictReader(file)
    wanted = {"dae_mm": "0.333333", "points": "19881", "iae": "", "frequencies": "1;2;5", "aligned": "", "sbr": "0.1"}
    assert tuple(row) == COLUMNS and {name: row[name] for name in wanted} == wanted
    again = Results(path)[KEY]
    assert number(again, "dae_mm") == pytest.approx(1 / 3, abs=1e-6) and np.isnan(number(again, "iae"))
    for other in ({"sketch_size": None}, {"sbr": 1.0}, {"tolerance_bins": 10.0}, {"aligned": (2, 8, 60.0)}):
        assert KEY in Results(path) and KEY | other not in Results(path)
    assert KEY not in Results(path, fresh=True) and len(path.read_text().splitlines()) == 1


def test_half_a_line_is_forgotten(path):
    results = Results(path)
    results.append(ROW)
    results.append(ROW | {"repeat": 2})
    path.write_text(path.read_text()[:-30])
    again = Results(path)
    assert KEY in again and KEY | {"repeat": 2} not in again
    again.append(ROW | {"repeat": 2})
    assert len(path.read_text().splitlines()) == 3 and KEY | {"repeat": 2} in Results(path)


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", ",".join((*COLUMNS, "format")).encode(), b"\xff\xfe\x00"])
def test_a_table_of_something_else_or_another_version_is_refused_and_left_alone(path, content):
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"results.csv is .*: expected "):
        Results(path)
    assert path.read_bytes() == content


def test_repeats_are_averaged_and_other_settings_are_not():
    other = JUDGED | {"repeat": "2", "true_detections_percent": "96", "dae_mm": "", "within_nominal_percent": "20;70",
                      "true_detections_by_surface_percent": "96"}
    rows = averaged([JUDGED, JUDGED | {"sketch_size": "5"}, other])
    assert [row["sketch_size"] for row in rows] == ["10", "5"]
    assert rows[0]["true_detections_percent"] == 93 and rows[0]["dae_mm"] == 2
    assert rows[0]["within_nominal_percent"] == (15, 60) and np.isnan(rows[0]["iae"])


def test_the_table_shows_what_is_known_and_a_dash_for_what_others_have():
    judged = JUDGED | {"true_detections_by_surface_percent": "99.06;80", "false_detections_percent": "0.04"}
    lines = markdown(averaged([judged, READ | {"sbr": "", "sketch_size": "", "source": "tower"}])).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert set(cells[0]) < set(HEADINGS) and len({len(line) for line in cells}) == 1
    assert dict(zip(cells[0], cells[2])) == {
        "source": "bust", "SBR": "1", "photons / pixel": "9.9", "method": "pooled", "m": "10", "TD %": "99.1 + 80.0",
        "FD %": "0.0", "DAE mm": "2.00", "points": "100"}
    assert cells[3][:6] == ["tower", "–", "9.9", "pooled", "–", "–"]
