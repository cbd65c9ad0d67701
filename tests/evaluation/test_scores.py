"""results.csv, which any program can read; and the table made of it."""

import csv

import numpy as np

from srt3d_ros.evaluation.scores import HEADINGS, RESULT_COLUMNS, averaged, is_table, markdown, table_of_rows

ROW = {"source": "bust", "sbr": 1.0, "ppp": 10.0, "repeat": 1, "method": "pooled", "sketch_size": 10,
       "photons_per_pixel": 9.9, "points": 100}
JUDGED = ROW | {"true_detections_percent": 90.0, "true_detections_by_surface_percent": (90.0,), "dae_mm": 2.0}


def test_a_row_is_on_the_disk_at_once_and_found_by_any_program(tmp_path):
    path = tmp_path / "results.csv"
    with table_of_rows(path) as write:
        write(ROW | {"dae_mm": 1 / 3, "points": 19_881, "iae": float("nan"), "frequencies": (1, 2, 5), "sbr": 0.1})
        with open(path, newline="") as file:
            row, = csv.DictReader(file)
    wanted = {"dae_mm": "0.333333", "points": "19881", "iae": "", "frequencies": "1;2;5", "sbr": "0.1"}
    assert tuple(row) == RESULT_COLUMNS and {name: row[name] for name in wanted} == wanted


def test_a_table_is_known_by_its_columns(tmp_path):
    path = tmp_path / "results.csv"
    for content in (b"", b"a,b\n1,2\n", b"\xff\xfe\x00"):
        path.write_bytes(content)
        assert not is_table(path)
    with table_of_rows(path):
        pass
    assert is_table(path)


def test_repeats_are_averaged_and_other_settings_are_not():
    other = JUDGED | {"repeat": 2, "true_detections_percent": 96.0, "dae_mm": float("nan"),
                      "true_detections_by_surface_percent": (96.0,)}
    rows = averaged([JUDGED, JUDGED | {"sketch_size": 5}, other])
    assert [row["sketch_size"] for row in rows] == [10, 5]
    assert rows[0]["true_detections_percent"] == 93 and rows[0]["dae_mm"] == 2
    assert rows[0]["true_detections_by_surface_percent"] == (93,) and np.isnan(rows[0]["iae"])


def test_the_table_shows_what_is_known_and_a_dash_for_what_others_have():
    judged = JUDGED | {"true_detections_by_surface_percent": (99.06, 80.0), "false_detections_percent": 0.04}
    unjudged = ROW | {"sbr": None, "sketch_size": None, "source": "tower"}
    lines = markdown(averaged([judged, unjudged])).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert set(cells[0]) < set(HEADINGS) and len({len(line) for line in cells}) == 1
    assert dict(zip(cells[0], cells[2])) == {
        "source": "bust", "SBR": "1", "photons / pixel": "9.9", "method": "pooled", "m": "10", "TD %": "99.1 + 80.0",
        "FD %": "0.0", "DAE mm": "2.00", "points": "100"}
    assert cells[3][:6] == ["tower", "–", "9.9", "pooled", "–", "–"]
