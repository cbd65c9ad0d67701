"""The scene of the simulator: a head and shoulders."""

import numpy as np
import pytest

from srt3d_ros.datasets.simulation.bust import Bust, Figure, Part
from srt3d_ros.datasets.simulation.scene import default_sensor


@pytest.fixture(scope="module")
def bust() -> Bust:
    return Bust(default_sensor())


def test_a_ball_is_hit_where_geometry_says():
    ball = Figure((Part((0, 0, 0), (10, 10, 10), 0.5),))
    origin = np.array([0, 0, -1], np.float32)
    sideways = np.linspace(0, 0.15, 50)
    rays = np.stack([sideways, 0 * sideways, np.ones(50)]).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=0)
    along = rays[2].astype(np.float64)                          # |origin| = 1: nearest approach to the centre
    inside = along**2 - 1 + 0.1**2
    expected = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
    clear = np.abs(inside) > 1e-3                               # not the rays that graze it
    np.testing.assert_allclose(ball.march(origin, rays)[clear], expected[clear], atol=3e-4)


def test_the_bust_is_a_head_on_shoulders_before_a_wall(bust):
    range_m = bust.frame(0)[0][0]
    person = range_m < 2.35
    width = person.sum(axis=1)
    assert not person[0].any() and person[-1].all()             # wall above the head, shoulders across the bottom
    assert not person[:100, [0, -1]].any()                      # wall beside the head
    head, neck = width[60:70].max(), width[105:116].min()
    assert 55 < head < 80 and 25 < neck < head                  # a neck narrower than the head
    assert np.abs(person[20:110].astype(int) - person[20:110, ::-1]).mean() < 0.01     # looks straight ahead at t = 0


def test_the_head_turns_smoothly_well_within_the_sensors_window(bust):
    sensor, nose = default_sensor(), []
    for t_s in np.arange(2, 6, 0.25):
        range_m, reflectivity = bust.frame(t_s)
        bins = (range_m - sensor.range_m(0)) / sensor.bin_width_m
        assert 500 < bins.min() and bins.max() < sensor.num_bins - len(sensor.irf)
        assert range_m.dtype == reflectivity.dtype == np.float32
        assert 0 < reflectivity.min() and reflectivity.max() <= 1
        nose.append(np.unravel_index(np.argmin(range_m[0]), (141, 141))[1])
    assert max(nose) > 85 and min(nose) < 55 and np.abs(np.diff(nose)).max() <= 12
