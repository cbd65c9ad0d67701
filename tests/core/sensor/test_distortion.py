"""plumb_bob distortion: the inverse against the model as OpenCV writes it, and models that cannot be inverted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.errors import InvalidInput

ROWS, COLS = 24, 32


def seen_at(lens: Pinhole, rays: np.ndarray) -> np.ndarray:
    """(col, row) at which points on these rays appear, [rows, cols, 2], as OpenCV's projectPoints says."""
    x, y = np.moveaxis(rays[..., :2].astype(np.float64) / rays[..., 2:], -1, 0)
    d, r = lens.distortion, np.hypot(x, y)
    gain = 1 + d.k1 * r**2 + d.k2 * r**4 + d.k3 * r**6
    bent_x = x * gain + 2 * d.p1 * x * y + d.p2 * (r**2 + 2 * x**2)
    bent_y = y * gain + d.p1 * (r**2 + 2 * y**2) + 2 * d.p2 * x * y
    return np.stack([lens.fx * bent_x + lens.cx, lens.fy * bent_y + lens.cy], axis=-1)


def pixels(rows: int, cols: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1)


def test_a_wide_lens_of_a_real_camera():
    """A barrel of 100° across the corners."""
    lens = Pinhole(458.65, 457.3, 367.2, 248.4, PlumbBob(-0.2834, 0.07396, 0.00019, 0.000018))
    rays = lens.rays(480, 752)
    np.testing.assert_allclose(seen_at(lens, rays), pixels(480, 752), atol=1e-3)
    straight = Pinhole(458.65, 457.3, 367.2, 248.4).rays(480, 752)
    assert np.abs(rays - straight).max() > 0.05 and np.abs(rays - straight)[248, 367].max() < 1e-5


@pytest.mark.parametrize("lens", [
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(k1=-0.5)),                     # turns back at r = 0.82, x' = 0.54
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(k1=-0.8, k2=-0.6, k3=0.68)),   # turns back, and forth again
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(p1=0.4, p2=0.4)),
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(1e300, 1e300, 1e300, -1e300, 1e300)),
    Pinhole(1e-3, 1e-3, 15.5, 11.5, PlumbBob(k3=-1e-3)),
], ids=["one fold", "two folds", "tangential", "huge", "short focal length"])
def test_a_model_that_folds_inside_the_image_is_refused_in_one_line(lens):
    one_line = "^projection.distortion is k1 .*: expected a model that shows one ray at each pixel; this .*$"
    with pytest.raises(InvalidInput, match=one_line):
        SensorModel(ROWS, COLS, 50, 1e-10, np.ones(3), projection=lens)


@settings(max_examples=100, deadline=None)
@given(coefficients=st.tuples(*map(st.floats, (-2, -2, -0.1, -0.1, -2), (2, 2, 0.1, 0.1, 2))),
       focal=st.floats(5, 100), centre=st.floats(-40, 70))
def test_any_model_is_inverted_or_refused(coefficients, focal, centre):
    lens = Pinhole(focal, focal, centre, 11.5, PlumbBob(*coefficients))
    try:
        rays = SensorModel(ROWS, COLS, 50, 1e-10, np.ones(3), projection=lens).rays
    except InvalidInput as error:
        assert error.field == "projection.distortion" and len(str(error).splitlines()) == 1
    else:
        np.testing.assert_allclose(seen_at(lens, rays), pixels(ROWS, COLS), atol=1e-3)
        turned = np.cross(np.gradient(rays, axis=1), np.gradient(rays, axis=0))
        assert ((turned * rays).sum(axis=-1) > 0).all()         # neighbours stay neighbours: nothing is folded over


def test_coefficients_that_are_not_finite_are_refused():
    with pytest.raises(InvalidInput, match="^projection.distortion.p2 is nan"):
        PlumbBob(p2=np.nan)
