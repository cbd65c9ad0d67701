"""Frames of a moving sensor: which part a photon belongs to, and deskewed sketches: of photons that came elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.motion.deskew import FAR_M, Deskewer
from srt3d_ros.core.motion.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from tests.core.scenes import assert_same_sketch, through

ROWS, COLS, T = 9, 12, 200
STEP = 0.02             # rad from pixel to pixel
SENSOR = SensorModel(ROWS, COLS, T, 1e-10, [1, 2, 1], projection=AngularScan(0.1, -STEP, 0.1, -STEP))
FREQUENCIES = (1, 3, 20)
LATER = 10**8


def photons(seed: int = 0, number: int = 2_000, sensor: SensorModel = SENSOR) -> PhotonEvents:
    rng = np.random.default_rng(seed)
    return PhotonEvents(rng.integers(0, sensor.pixels, number, dtype=np.uint32),
                        rng.uniform(0, T, number).astype(np.float32))


def moved(events: PhotonEvents, pose: Pose, range_m=None, sensor: SensorModel = SENSOR):
    """As seen LATER, when the sensor is where `pose` is the one that it had at 0; and how many photons were lost."""
    deskewer, range_m = Deskewer(sensor, FREQUENCIES), constant(FAR_M, sensor) if range_m is None else range_m
    parts = [(0, sketch_photons(events, sensor, FREQUENCIES))]
    return deskewer(parts, through([(0, pose), (LATER, Pose())]), LATER, range_m), deskewer.lost


def constant(range_m: float, sensor: SensorModel = SENSOR) -> np.ndarray:
    return np.full((sensor.rows, sensor.cols), range_m, np.float32)


def test_a_step_forward_shifts_the_photons_of_the_middle():
    sensor = SENSOR.replace(rows=1, cols=1, projection=AngularScan(0, STEP, 0, STEP))
    events, step_m = photons(sensor=sensor), 16.6875 * sensor.bin_width_m        # sketches know sixteenths of bins
    shifted = replace(events, toa=((events.toa - step_m / sensor.bin_width_m) % T).astype(np.float32))
    for range_m in (None, np.full((1, 1), 2, np.float32)):
        sketch, _ = moved(events, Pose(translation=np.array([-step_m, 0, 0])), range_m, sensor)
        assert_same_sketch(sketch, sketch_photons(shifted, sensor, FREQUENCIES), 2e-4)


def test_half_a_column_shares_photons_but_not_across_an_edge():
    sensor = SENSOR.replace(rows=1, projection=AngularScan(0.1, -STEP, 0, STEP))
    events = PhotonEvents(np.full(101, 5, np.uint32), np.full(101, 40, np.uint16))
    sketch, lost = moved(events, Pose.turned([0, 0, -0.5 * STEP]), None, sensor)
    assert set(sketch.photons[0, 5:7]) <= {50, 51} and sketch.photons.sum() in (100, 101, 102) and lost == 0
    np.testing.assert_allclose(np.abs(sketch.z[0, 5:7]), 1, atol=1e-5)
    range_m = np.where(np.arange(COLS) < 6, 1.0, 4.0)[None].astype(np.float32)
    events = PhotonEvents(np.full(100, 5, np.uint32), np.full(100, 40, np.uint16))
    sketch, _ = moved(events, Pose.turned([0, 0, -0.3 * STEP]), range_m, sensor)     # 5.3: pixel 6 is another surface
    assert sketch.photons[0, 5] == 100 and sketch.photons[0, 6] == 0


@pytest.mark.parametrize("ppp", [0.1, 1, 10])
def test_rounding_keeps_the_number_of_photons_however_few_there_are(ppp):
    sensor = SENSOR.replace(rows=60, cols=80)
    events = photons(number=round(ppp * sensor.pixels), sensor=sensor)
    sketch, lost = moved(events, Pose.turned([0, 0.5 * STEP, 0.5 * STEP]), None, sensor)
    most = np.sqrt(sensor.pixels)       # 3.5 standard deviations of as many roundings
    assert int(sketch.photons.sum()) == pytest.approx(events.photons - lost, abs=most)


def test_parallax_needs_the_range_and_is_that_of_the_point():
    lens = Pinhole(40, 40, 5.5, 4)
    sensor = SENSOR.replace(projection=lens)
    range_m = np.linalg.norm(lens.rays(ROWS, COLS) / lens.rays(ROWS, COLS)[..., 2:], axis=-1).astype(np.float32) * 2
    near, far = (moved(photons(), Pose(translation=np.array([0.1, 0, 0])), ranges, sensor)[0]
                 for ranges in (range_m, None))       # a wall at z = 2 m: by 40 · 0.1 / 2 = 2 columns
    before = sketch_photons(photons(), sensor, FREQUENCIES)
    np.testing.assert_allclose(near.photons[:, 2:], before.photons[:, :-2], atol=1)         # rounded
    np.testing.assert_allclose(far.photons, before.photons, atol=1)
    shift = (range_m[4, 7] - range_m[4, 5]) / sensor.bin_width_m
    turned = np.exp(2j * np.pi * np.array(FREQUENCIES) * shift / T)
    np.testing.assert_allclose(near.z[4, 7], before.z[4, 5] * turned, atol=0.02)


@pytest.mark.parametrize(("background", "gate"), [(0, None), (20, None), (20, (20, 149))])
def test_photons_show_the_ranges_by_which_they_move(background, gate):
    """Two walls, with masked pixels, delays, background and a gate: each at its range but near the edge."""
    late = np.linspace(-3, 3, 40 * 60, dtype=np.float32).reshape(40, 60)
    mask = np.arange(40 * 60).reshape(40, 60) % 11 > 0
    sensor = SENSOR.replace(rows=40, cols=60, mask=mask, delay_bins=late, toa_offset_bins=10.0, irf_ref=0)
    wall = np.where(np.arange(60) < 30, 60.0, 90.0) + np.zeros((40, 1))
    rng = np.random.default_rng(0)
    pixel = np.arange(sensor.pixels, dtype=np.uint32).repeat(20 + background)
    toa = (wall + late).ravel()[pixel] + rng.choice([0, 1, 2], pixel.size, p=[0.25, 0.5, 0.25])
    toa = np.where(np.arange(pixel.size) % (20 + background) < 20, np.rint(toa), rng.integers(0, T, pixel.size))
    events = PhotonEvents(pixel, (toa % T).astype(np.uint16))
    chosen = gate and Gate(sensor, *gate)
    deskewer = Deskewer(chosen.sensor if gate else sensor, FREQUENCIES)
    found = deskewer.ranges_m([(0, sketch_photons(events, sensor, FREQUENCIES, chosen))])
    inner = np.s_[:, np.r_[:20, 40:60]]
    np.testing.assert_allclose(found[inner], sensor.range_m(wall)[inner], rtol=0.12)
    assert found.shape == (40, 60) and found.dtype == np.float32


def test_without_frequency_one_or_photons_ranges_are_far():
    assert (Deskewer(SENSOR, (2, 3)).ranges_m([(0, sketch_photons(photons(), SENSOR, (2, 3)))]) == FAR_M).all()
    nothing = sketch_photons(photons(number=0), SENSOR, FREQUENCIES)
    assert np.isfinite(Deskewer(SENSOR, FREQUENCIES).ranges_m([(0, nothing)])).all()


def test_masked_pixels_give_nothing_and_delays_are_those_of_the_pixel():
    mask = np.ones((1, COLS), bool)
    mask[0, 3] = False
    late = np.linspace(0, 7, COLS, dtype=np.float32)[None]
    sensor = SENSOR.replace(rows=1, projection=AngularScan(0.1, -STEP, 0, STEP), mask=mask, delay_bins=late)
    events = PhotonEvents(np.array([3, 5, 5], np.uint32), np.array([50, 40, 40], np.uint16))
    sketch, lost = moved(events, Pose.turned([0, 0, -STEP]), None, sensor)
    assert lost == 0 and sketch.photons.sum() == 2 == sketch.photons[0, 6]
    expected = np.exp(2j * np.pi * np.array(FREQUENCIES) * (40 + late[0, 6] - late[0, 5]) / T)
    np.testing.assert_allclose(sketch.z[0, 6], expected, atol=1e-3)


def test_cycles_and_those_that_a_dead_time_blinds_add_up():
    sensor = SENSOR.replace(cycles=600, dead_time_s=2.8 * T * 1e-10)
    gate, still = Gate(sensor, 20, 149), through([(0, Pose()), (LATER, Pose())])
    parts = [(stamp, sketch_photons(photons(seed), sensor, FREQUENCIES, gate)) for seed, stamp in enumerate((0, LATER))]
    moved = Deskewer(gate.sensor, FREQUENCIES)(parts, still, LATER, constant(FAR_M))
    assert moved.cycles == 1200 and moved.sensor.dead_time == gate.sensor.dead_time and moved.before.any()
    np.testing.assert_array_equal(moved.before, parts[0][1].before + parts[1][1].before)
    assert abs(moved.photons.sum(dtype=int) - sum(part.photons.sum(dtype=int) for _, part in parts)) <= 1


MS = 10**6


def packet(stamp_ns: int) -> PhotonEvents:
    return replace(photons(stamp_ns, 200), stamp_ns=stamp_ns)


def frame_of(sketcher: MovingSketcher, stamps_ms):
    for stamp in stamps_ms:
        sketcher.add(packet(stamp * MS))
    return sketcher.end_frame()


def instants_ms(frame) -> list[float]:
    return [instant / MS for instant, _ in frame.parts]


@pytest.mark.parametrize("order", [(0, 10, 20, 30), (30, 10, 0, 20)])
def test_each_stamp_is_a_part_in_the_middle_of_its_packet(order):
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), order)
    assert instants_ms(frame) == [5, 15, 25, 35]
    assert (frame.first_ns, frame.last_ns, frame.stamp_ns) == (5 * MS, 35 * MS, 20 * MS)
    for stamp, (_, sketch) in zip((0, 10, 20, 30), frame.parts):
        assert_same_sketch(sketch, sketch_photons(packet(stamp * MS), SENSOR, FREQUENCIES))


def test_parts_last_until_the_next_stamp_and_a_pause_is_no_packet():
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), (0, 0, 10, 40, 40, 50))
    assert instants_ms(frame) == [5, 15, 45, 55]
    assert [int(sketch.photons.sum()) for _, sketch in frame.parts] == [400, 200, 400, 200]
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    first, second = (frame_of(sketcher, (stamp,)) for stamp in (0, 100))
    assert (instants_ms(first), first.stamp_ns) == ([0], 0)            # nothing is known yet
    assert (instants_ms(second), second.stamp_ns) == ([150], 150 * MS)
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    for first in (0, 100, 200):
        frame = frame_of(sketcher, (first, first + 10))
    assert instants_ms(frame) == [205, 215] and frame.stamp_ns == 210 * MS


def test_more_packets_than_parts_share_them_evenly_from_the_second_frame_on():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, parts=4)
    first = frame_of(sketcher, range(0, 100, 5))
    assert len(first.parts) == 4 and sum(int(sketch.photons.sum()) for _, sketch in first.parts) == 4_000
    second = frame_of(sketcher, range(100, 200, 5))
    assert instants_ms(second) == [112.5, 137.5, 162.5, 187.5]
    assert [int(sketch.photons.sum()) for _, sketch in second.parts] == [1_000] * 4


def test_a_turning_sensor_brings_the_parts_together():
    """A point seen by pixel 2, 3, 4 …: the sensor turns by a column a packet."""
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    trajectory = through((k * 10 * MS - 5 * MS, Pose.turned([0, 0, STEP * k])) for k in range(8))
    for k in range(8):
        sketcher.add(PhotonEvents(np.full(10, 2 + k, np.uint32), np.full(10, 50, np.uint16), k * 10 * MS))
    frame = sketcher.end_frame()
    frame = MovingFrame(frame.parts[:7], frame.first_ns, 65 * MS, 5 * MS)
    sketch = sketcher.finish(frame, trajectory)
    assert sketch.photons[0, 2] >= 69 and sketch.photons.sum() - sketch.photons[0, 2] <= 1
    assert np.abs(sketch.z[0, 2]).min() > 0.99


def test_photons_outside_the_gate_are_dropped_and_those_inside_counted():
    sketcher = MovingSketcher(SENSOR, (1, 4, 20), gate=Gate(SENSOR, 20, 79))
    sketcher.add(PhotonEvents(np.arange(4, dtype=np.uint32), np.array([10, 30, 40, 90], np.uint16), 0))
    sketcher.add(PhotonEvents(np.arange(4, dtype=np.uint32), np.array([20, 79, 80, 0], np.uint16), MS))
    frame = sketcher.end_frame()
    assert sketcher.finish(frame, through([(0, Pose()), (10**10, Pose())])).photons.sum() == 4
