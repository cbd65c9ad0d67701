"""Odd sensors and frames through every method: numbers come out, or one line says what cannot be used."""

from robustness import frames

ROUNDS = 100


def test_every_method_gives_numbers_or_refuses_in_one_line(monkeypatch):
    monkeypatch.setattr(frames, "PERIODS", [2, 3, 4, 5, 8, 33, 100, 586])
    tally = frames.play_all(range(ROUNDS), seed=1)
    assert tally.failures == []
    assert tally.clouds > ROUNDS / 4 and tally.points > 300 and len(tally.refused) > 5


def test_a_cloud_with_a_number_out_of_its_range_is_a_fault(ball):
    cloud, sensor = ball
    assert frames.faults(cloud, sensor) == []
    cloud.depth_bins[0] = sensor.num_bins
    assert frames.faults(cloud, sensor)[0].startswith("depth_bins out of its range")
    cloud.depth_bins[0] = 0
