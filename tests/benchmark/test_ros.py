"""The search for the highest rate, and what is said of a rate."""

import pytest

from srt3d_ros.benchmark import ros
from srt3d_ros.nodes.pipeline_probe import Arrival


def player(limit_hz, failures=()):
    """A pipeline that keeps up to a rate, but for the calls numbered in `failures`; and the rates it was asked for."""
    asked = []

    def play(rate_hz):
        asked.append(rate_hz)
        lost = rate_hz > limit_hz or len(asked) in failures
        return {"rate_hz": rate_hz, "frames_lost": 3 if lost else 0, "clouds_per_s": min(rate_hz, limit_hz)}

    return play, asked


@pytest.mark.parametrize("limit_hz", [0, 1.7, 33.0, 1e9])
def test_the_highest_rate_is_found(limit_hz):
    """0: everything is lost; 1e9: there is no limit. Both end the search."""
    play, asked = player(limit_hz)
    found = ros.highest(list(ros.search(play, 5)))["rate_hz"]
    assert ros.LEAST_HZ <= min(asked) and max(asked) <= ros.MOST_HZ and len(asked) < 25
    assert found <= limit_hz and min(limit_hz, ros.MOST_HZ) <= (2 if limit_hz == 1e9 else 1.05) * found


def test_a_rate_may_fail_once():
    play, asked = player(33.0, failures=(2,))
    assert ros.highest(list(ros.search(play, 0)))["rate_hz"] == 20.0 and asked[:3] == [10.0, 20.0, 20.0]


def test_the_figures_of_a_rate():
    arrivals = [Arrival(stamp_ns=k * 10**8, received_ns=k * 10**8 + (20 + k) * 10**6, points=1) for k in range(11)]
    line = ros.outcome(10.0, 12, arrivals)
    assert (line["frames_sent"], line["frames_lost"]) == (12, 1)
    assert line["clouds_per_s"] == pytest.approx(10 / 1.01, abs=0.01)
    assert line["latency_ms"] == {"min": 20, "median": 25, "p95": 29.5, "max": 30}
    assert not ros.kept_up(line) and ros.kept_up(line | {"frames_lost": 0})
    assert not ros.kept_up(line | {"frames_lost": 0, "clouds_per_s": 9.0})      # the player was too slow
    assert ros.outcome(10.0, 12, [])["latency_ms"] is None


def test_the_table_has_the_rates_in_order():
    line = {"what": "rate", "rows": 141, "cols": 141, "ppp": 10.0, "rate_hz": 20.0, "frames_sent": 60, "frames_lost": 7,
            "clouds_per_s": 15.0, "latency_ms": {"min": 1.0, "median": 60.0, "p95": 70.0, "max": 80.0}}
    good = line | {"rate_hz": 10.0, "frames_lost": 0, "clouds_per_s": 10.0}
    text = ros.table([line, good, good | {"what": "highest rate"}]).splitlines()
    assert text[2].startswith("| 10 ") and text[3].startswith("| 20 ") and "too fast" in text[3]
    assert "too fast" not in text[2] and text[4].startswith("Highest rate without loss: 10 Hz (141 × 141")


def test_without_ros_the_part_is_left_out_and_says_so(tiny, bar, monkeypatch):
    monkeypatch.setattr(ros.importlib.util, "find_spec", lambda name: None if name == "rclpy" else name)
    assert list(ros.measure(tiny, bar)) == [] and bar.notes == ["left out: rclpy is not installed"]
