"""`seen_ranges` against its sentence, point by point."""

import numpy as np
import pytest

from srt3d_ros.kernels import cpu

from .test_move_sketch import LENSES, seen_at


@pytest.mark.parametrize("lens", [LENSES["pinhole"], LENSES["distorted"], LENSES["scan"]], ids=lambda lens: lens.kind)
def test_each_pixel_sees_the_nearest_point_and_holes_lie_between_their_neighbours(lens):
    rng, shape = np.random.default_rng(0), (13, 21)
    rays = lens.rays(*shape).reshape(-1, 3)
    xyz = (rays[rng.integers(0, len(rays), 60)] * rng.uniform(1, 3, (60, 1)) + rng.normal(scale=0.02, size=(60, 3)))
    xyz[:3] = -xyz[:3]                  # behind a camera
    expected = np.full(shape, np.inf)
    for point in xyz[3:] if len(lens.lens) > 4 else xyz:
        row, col = seen_at(point, lens.lens)
        above, left = int(np.floor(row)), int(np.floor(col))
        for i, j in ((above, left), (above, left + 1), (above + 1, left), (above + 1, left + 1)):
            if 0 <= i < shape[0] and 0 <= j < shape[1]:
                expected[i, j] = min(expected[i, j], np.linalg.norm(point))
    found, known = cpu.seen_ranges(xyz.astype(np.float32), lens.lens, shape), np.isfinite(expected)
    assert 30 < known.sum() < known.size - 30
    np.testing.assert_allclose(found[known], expected[known], rtol=1e-5)
    assert (found >= expected.min() - 1e-5).all() and (found <= expected[known].max() + 1e-5).all()


def test_without_points_nothing_is_seen():
    assert np.isinf(cpu.seen_ranges(np.empty((0, 3), np.float32), LENSES["pinhole"].lens, (3, 4))).all()
