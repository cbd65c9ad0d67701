"""Sketch: which frequencies it may have, and that sketches add."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, MAX_SKETCH_SIZE, PhaseSums, check_frequencies
from srt3d_ros.errors import InvalidInput


def sensor(rows: int, cols: int, bin_width_s: float = 1e-10) -> SensorModel:
    return SensorModel(rows, cols, 100, bin_width_s, [1.0])


def make(rows=2, cols=3, frequencies=(1, 4), seed=0, stamp_ns=0, **changes) -> PhaseSums:
    rng = np.random.default_rng(seed)
    photons = rng.integers(0, 9, (rows, cols)).astype(np.uint32)
    phases = np.exp(1j * rng.uniform(0, 6, (rows, cols, len(frequencies))))
    return PhaseSums(frequencies, (photons[..., None] * phases).astype(np.complex64), photons, stamp_ns,
                  sensor=sensor(rows, cols, **changes))


@pytest.mark.parametrize(("call", "said"), [
    *((partial(check_frequencies, k, 100), said) for k, said in (
        ([], "sketch size is 0"), (range(1, MAX_SKETCH_SIZE + 2), f"sketch size is {MAX_SKETCH_SIZE + 1}"),
        ([0], "frequencies is 0"), ([1.5], "frequencies is 1.5"), ([float("nan")], "frequencies is nan"),
        ([1, 2, 1], r"frequencies is \[1, 2, 1\]: expected no frequency twice"))),
    *((lambda changes=changes: make() + make(**changes), said) for changes, said in (
        ({"frequencies": (1, 5)}, r"frequencies is \(1, 5\): expected the same as \(1, 4\)"),
        ({"rows": 1}, r"Cannot add sketches of different sensors \(rows 2 and 1\)\."),
        ({"bin_width_s": 1e-9}, r"Cannot add sketches of different sensors \(bin_width_s 1e-10 and 1e-09\)\."))),
    *((lambda sums=sums, photons=photons: PhaseSums((1, 4), np.zeros(sums, np.complex64), np.zeros(photons, np.uint32),
                                                    sensor=sensor(2, 3)), said) for sums, photons, said in (
        ((2, 3, 3), (2, 3), "sums shape"), ((6, 2), (2, 3), "sums is"), ((2, 3, 2), (3, 2), "photons shape"),
        ((3, 2, 2), (2, 3), "sums shape")))])
def test_what_cannot_be_used_is_refused(call, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        call()


@pytest.mark.parametrize(("num_bins", "most"), [(2, 1), (100, 49), (101, 50)])
def test_the_highest_frequency_has_more_than_two_bins_a_turn(num_bins, most):
    assert check_frequencies([most], num_bins) == (most,)
    with pytest.raises(InvalidInput, match=f"from 1 to {most} "):
        check_frequencies([most + 1], num_bins)


def test_z_is_the_mean_and_sketches_add_with_their_cycles_and_the_earliest_stamp():
    sketch = PhaseSums((1, 2), np.array([[[4, 2j], [1, 1j], [0, 0]]], np.complex64), np.array([[4, 1, 0]], np.uint32),
                    sensor=sensor(1, 3))
    assert sketch.z.dtype == np.complex64
    np.testing.assert_allclose(sketch.z, [[[1, 0.5j], [1, 1j], [0, 0]]])
    one, other = make(seed=1, stamp_ns=7), make(seed=2, stamp_ns=5)
    total = one + other
    np.testing.assert_allclose(total.sums, one.sums + other.sums)
    assert np.array_equal(total.photons, one.photons + other.photons) and total.stamp_ns == 5
    assert total.sums.dtype == np.complex64 and total.photons.dtype == np.uint32
    one, before = make(), np.ones((2, 3), np.uint32)
    known, gated = replace(one, cycles=100), replace(one, cycles=50, before=before)
    assert (known + known).cycles == 200 and (known + known).before is None
    assert (known + gated).cycles == 150 and (gated + gated).before.tolist() == [[2] * 3] * 2
    assert (known + one).cycles == (one + known).cycles == 0
    assert (gated.armed_cycles == 49).all()


def test_more_photons_than_32_bits_hold_are_a_full_pixel_of_the_same_mean():
    photons = np.full((2, 2), 3_000_000_000, np.uint32)
    sketch = PhaseSums((1,), ((0.6 + 0.8j) * photons[..., None]).astype(np.complex64), photons, sensor=sensor(2, 2))
    total = sketch + sketch
    assert (total.photons == MAX_PIXEL_PHOTONS).all() and total.photons.dtype == np.uint32
    np.testing.assert_allclose(total.z, 0.6 + 0.8j, rtol=1e-6)
