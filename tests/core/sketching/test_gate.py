"""Gate: photons outside are dropped, and those inside keep their ranges."""

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate, parse
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import assert_same_sketch
from tests.photon_forms import as_gates

ROWS, COLS, T = 6, 7, 160
IRF = np.exp(-0.5 * (np.arange(13) - 5) ** 2 / 3)
LATE = (np.arange(ROWS * COLS, dtype=np.float32).reshape(ROWS, COLS) % 5) * 3 - 4.5         # −4.5 … 7.5 bins
SENSOR = SensorModel(ROWS, COLS, T, 1e-10, IRF, toa_offset_bins=20, range_offset_m=0.3, gates=GateWords(3, 0))
SENSORS = {"plain": SENSOR, "delays": SENSOR.replace(delay_bins=LATE),
           "long delays": SENSOR.replace(delay_bins=LATE + 130), "far delays": SENSOR.replace(delay_bins=LATE - 12_345)}
GATE, FREQUENCIES = (50, 119), (1, 2, 3, 5, 8, 12)
EVERY = pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)


def observe(sensor=SENSOR, depth=80.0, dtype=np.uint16, background=20, ordered=True, stamp_ns=5) -> PhotonEvents:
    """A plane, 60 photons a pixel, and an even background."""
    rng = np.random.default_rng(1)
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 60)
    late = sensor.late.reshape(-1).astype(float)
    time = depth + rng.normal(0, np.sqrt(3), len(pixel)) + late[pixel]
    pixel = np.concatenate([pixel, rng.integers(0, sensor.pixels, background * sensor.pixels, dtype=np.uint32)])
    time = np.concatenate([time, rng.uniform(0, T, background * sensor.pixels)])
    steps = 16 if dtype == np.float32 else 1                    # of a bin, to which sketches round
    time = np.floor(time * steps + 0.5) / steps % T
    order = np.argsort(pixel, kind="stable") if ordered else rng.permutation(len(pixel))
    return PhotonEvents(pixel[order], time[order].astype(dtype), stamp_ns)


@EVERY
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_the_sketch_is_that_of_the_photons_inside_in_every_form(sensor, dtype):
    gate = Gate(sensor, *GATE)
    for ordered in (True, False):
        events = observe(sensor, dtype=dtype, ordered=ordered)
        inside = gate.photons(events)
        assert 0 < inside.photons < events.photons
        inside.check(gate.sensor)
        expected = sketch_photons(inside, gate.sensor, FREQUENCIES)
        assert expected.photons.sum() == inside.photons
        assert_same_sketch(sketch_photons(events, sensor, FREQUENCIES, gate), expected)
    if dtype == np.uint16:
        words = as_gates(events, sensor)
        assert_same_sketch(sketch_photons(words, sensor, FREQUENCIES, gate), expected)


@EVERY
@pytest.mark.parametrize("depth", [57.3, 112.8])        # a pulse's length from either end
def test_a_gate_leaves_ranges_and_points_as_they_are(sensor, depth):
    events, gate = observe(sensor, depth), Gate(sensor, *GATE)
    whole = Pooled(sensor, FREQUENCIES)(sketch_photons(events, sensor, FREQUENCIES))
    cloud = Pooled(gate.sensor, FREQUENCIES)(sketch_photons(events, sensor, FREQUENCIES, gate))
    assert len(whole) == len(cloud) == sensor.pixels
    true = sensor.rays.reshape(-1, 3) * sensor.range_m(depth)
    for found in (whole, cloud):
        assert np.abs(found.xyz - true).max() < 0.5 * sensor.bin_width_m
    np.testing.assert_allclose(cloud.range_image(), gate.sensor.range_m(cloud.image("depth_bins")), rtol=1e-5)
    np.testing.assert_allclose(cloud.background.mean(), 20 * gate.num_bins / T, rtol=0.15)


def test_t_is_the_gates_length_and_the_spread_of_the_delays_and_the_ends_are_inside():
    assert Gate(SENSOR, *GATE).sensor.num_bins == 70
    delayed = Gate(SENSORS["delays"], *GATE)
    assert delayed.sensor.num_bins == 70 + 13 and delayed.sensor.delay_bins.min() == 0.5
    assert Gate(SENSORS["delays"], 2, 155).sensor is SENSORS["delays"]      # all bins are left
    delays, mask = LATE.copy(), np.ones(LATE.shape, bool)
    delays[2, 3], mask[2, 3] = 100, False
    assert Gate(SENSOR.replace(delay_bins=delays, mask=mask), *GATE).num_bins == 70 + 13
    gate = Gate(SENSOR, *GATE)
    toa = np.array([49, 50, 119, 120], np.uint16)
    assert gate.photons(PhotonEvents(np.arange(4, dtype=np.uint32), toa)).toa.tolist() == [0, 69]
    floats = np.array([49.4, 49.6, 119.4, 119.6], np.float32)
    inside = gate.photons(PhotonEvents(np.arange(4, dtype=np.uint32), floats))
    np.testing.assert_allclose(inside.toa, [69.6, 69.4], atol=1e-4)         # half of bin 0 lies before its centre


def test_the_background_is_cut_and_one_without_photons_inside_is_even():
    shape = np.arange(T, dtype=np.float64)
    gate = Gate(SENSOR.replace(background_shape=shape), *GATE)
    np.testing.assert_allclose(gate.sensor.background_shape, shape[50:120] / shape[50:120].sum(), rtol=1e-6)
    elsewhere = SENSOR.replace(background_shape=np.where(np.arange(T) < 50, 1.0, 0.0))
    assert Gate(elsewhere, *GATE).sensor.background_shape is None


def test_a_gate_may_be_written_as_a_list():
    for spec in ("100-400", "100:400", "100, 400", " [100,400] ", (100, 400), [100, 400], np.array([100, 400])):
        assert parse(spec) == (100, 400) and str(Gate(SENSOR, 50, 119)) == "50-119"


@pytest.mark.parametrize("spec", ["", "100:", 5, (5,), (1, 2, 3), "1:2:3", "1.5:4", "9" * 40 + ":1"])
def test_what_is_no_gate_is_refused(spec):
    with pytest.raises(InvalidInput, match="^gate is .*: expected off, FIRST-LAST"):
        parse(spec)
