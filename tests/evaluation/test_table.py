"""The table for people."""

import numpy as np

from srt3d_ros.evaluation.results import COLUMNS
from srt3d_ros.evaluation.table import HEADINGS, averaged, markdown

ROW = dict.fromkeys(COLUMNS, "") | {"source": "bust", "sbr": "1", "ppp": "10", "repeat": "1", "method": "pooled",
                                    "sketch_size": "10", "photons_per_pixel": "9.9", "points": "100"}
JUDGED = ROW | {"true_detections_percent": "90", "true_detections_by_surface_percent": "90", "dae_mm": "2",
                "within_nominal_percent": "10;50"}


def test_repeats_are_averaged_and_other_settings_are_not():
    other = JUDGED | {"repeat": "2", "true_detections_percent": "96", "dae_mm": "", "within_nominal_percent": "20;70",
                      "true_detections_by_surface_percent": "96"}
    rows = averaged([JUDGED, JUDGED | {"sketch_size": "5"}, other])
    assert [row["sketch_size"] for row in rows] == ["10", "5"]
    assert rows[0]["true_detections_percent"] == 93 and rows[0]["dae_mm"] == 2
    assert rows[0]["within_nominal_percent"] == (15, 60) and np.isnan(rows[0]["iae"])


def test_the_table_shows_what_is_known_and_a_dash_for_the_rest():
    judged = JUDGED | {"true_detections_by_surface_percent": "99.06;80", "false_detections_percent": "0.04"}
    lines = markdown(averaged([judged, ROW | {"sbr": "", "sketch_size": "", "source": "tower"}])).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert tuple(cells[0]) == HEADINGS and len({len(line) for line in cells}) == 1
    assert dict(zip(HEADINGS, cells[2])) == {
        "source": "bust", "SBR": "1", "photons / pixel": "9.9", "method": "pooled", "m": "10", "TD %": "99.1 + 80.0",
        "FD %": "0.0", "DAE bins": "–", "DAE mm": "2.00", "IAE": "–", "≤ 1 σ %": "–", "≤ 2 σ %": "–", "points": "100"}
    assert cells[3][:6] == ["tower", "–", "9.9", "pooled", "–", "–"]
