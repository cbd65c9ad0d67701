"""What keeps chance from growing, by both kinds of kernels, where the photons are known."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import SAME_SURFACE

from .frames import CPU, ORACLE, exact_frame, exact_state, make_terms, padded

BOTH = pytest.mark.parametrize("kernels", [CPU, ORACLE])
SHAPE = (40, 50)
ALL = np.ones((1, *SHAPE))
LEFT = ALL * (np.arange(SHAPE[1]) < 20)


def intensity(state) -> np.ndarray:
    return maps.crop(state, *SHAPE)[:, 0, maps.INTENSITY]


@BOTH
@pytest.mark.parametrize(("shown", "grows"), [(0, False), (0.05, True)])
def test_a_surface_grows_where_photons_show_it(kernels, shown, grows):
    frame, state = exact_frame(100 * ALL, 0.05 * LEFT + shown * (1 - LEFT), 0), exact_state(100 * ALL, 0.05 * LEFT)
    after, terms = kernels.birth_death(padded(frame), state, make_terms(frame, state), SAME_SURFACE**2)
    beyond = intensity(after)[:, 20:]
    assert (beyond[:, :3] > 0).all() if grows else not beyond.any()
    assert (maps.crop(terms, *SHAPE)[:, 0, maps.VALUE, 20:] != 0).any() == grows


@BOTH
def test_points_stay_near_one_that_is_sure(kernels):
    frame, state = exact_frame(100 * ALL, 2 * ALL, 0), exact_state(100 * ALL, 2 * ALL)
    view = maps.crop(state, *SHAPE)
    view[:, :, maps.SCORE] = 4.9
    view[5, 0, maps.SCORE, 7] = 5.1
    after = kernels.changed("drop_blobs", padded(frame), state, 5.0)[1]
    expected = np.zeros(SHAPE, bool)
    expected[:5 + 15, :7 + 15] = True           # within 1.5 · 9 pixels, rounded up
    np.testing.assert_array_equal(intensity(after) > 0, expected)
