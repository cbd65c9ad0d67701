"""Colour maps and the ranges they are spread over."""

import numpy as np
import pytest

from srt3d_ros.pictures import colours
from srt3d_ros.pictures.colours import RANGE_TABLE, AdaptiveRange, levels, packed, percentile_range, shaded


def test_tables_are_the_published_maps():
    matplotlib = pytest.importorskip("matplotlib")
    for name in (colours.RANGE_MAP, colours.PHOTON_MAP):
        published = np.round(np.asarray(matplotlib.colormaps[name](np.arange(256)))[:, :3] * 255)
        table = colours.colour_table(name).astype(int)
        assert np.abs(table - published).max() <= 11 and np.array_equal(table[::15], published[::15])


def test_levels_span_the_ends_clip_outside_and_take_nan_and_flat_data():
    values = np.array([-1, 0, 5, 10, 20, np.nan, np.inf])
    assert levels(values, (0, 10)).tolist() == [0, 0, 127, 255, 255, 0, 255]
    assert levels(np.array([2.5]), (0, 10), root=True).tolist() == [127]
    assert set(levels(np.full(4, 3.0), (3, 3)).tolist()) <= {0, 255}
    assert levels(np.arange(101))[[2, 98]].tolist() == [0, 255]


def test_the_colours_of_ranges_are_yellow_when_near_and_blue_when_far_and_none_is_too_dark():
    near, far = RANGE_TABLE[[0, 255]].astype(int)
    assert RANGE_TABLE.max(axis=1).min() >= 132
    assert near[0] > 200 and near[1] > 200 and near[2] < 60 and far[2] > 1.5 * max(far[:2])
    weak, strong = packed(shaded(RANGE_TABLE[[0, 0]], np.array([0, 255]))).tolist()
    assert weak >> 24 == int(0.5 * near[0]) and strong == int.from_bytes([*near, 255], "big")


def test_ranges_of_values_ignore_outliers_and_follow_slowly():
    values = np.concatenate([np.linspace(1, 2, 9800), np.full(100, 1e9), np.full(100, np.nan)])
    low, high = percentile_range(values)
    assert 1 <= low < 1.1 and 1.9 < high <= 2.01
    assert percentile_range(np.full(5, np.nan)) is None
    adaptive = AdaptiveRange()
    assert adaptive.update(np.empty(0)) == (0.0, 1.0)
    first = adaptive.update(np.linspace(0, 10, 1000))
    assert first == pytest.approx((0.2, 9.8), abs=0.02)
    assert adaptive.update(np.linspace(0, 110, 1000))[1] == pytest.approx(9.8 * 0.9 + 107.8 * 0.1, abs=0.1)
    assert adaptive.update(np.empty(0)) == adaptive.update(np.full(3, np.nan))
