"""The tolerance as a user writes it."""

import pytest

from srt3d_ros.datasets.scene import default_sensor, net_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.tolerance import Tolerance


@pytest.mark.parametrize(("text", "source", "bins"), [
    ("10", "a", 10), ("2.5", "a", 2.5), ("30mm", "a", 100), ("10,a=40", "a", 40), ("10,a=40", "b", 10),
    ("a=6mm, 10 ,b=3", "a", 20), ("30mm,a=40", "b", 100), ("10,a=b=40", "a=b", 40)])
def test_bins_or_millimetres_and_others_by_name(text, source, bins):
    assert Tolerance.parse(text).in_bins(source, default_sensor()) == pytest.approx(bins)


def test_millimetres_are_of_range():
    assert Tolerance(mm=75.0).in_bins("net", net_sensor()) == pytest.approx(2, rel=0.01)       # bins of 250 ps


@pytest.mark.parametrize("text", ["", "near", "10,20", "a=10", "10,a=", "10,a=near", "0", "-3", "nan", "inf", "0mm",
                                  "10cm", "10,a=0"])
def test_what_is_no_tolerance_is_refused_in_one_line(text):
    with pytest.raises(InvalidInput, match=r"^tolerance is .*: expected "):
        Tolerance.parse(text)
